"""Writes recordings of samples for tests; the simulator has a writer of its own."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import msgpack
import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from traverse.protocol.arrays import ARRAY_CODE, array_to_bytes
from traverse.recording.reader import SCHEMA
from traverse.recording.torn import PROFILE
from traverse.recording.values import TIMES, Conditions, Samples, Touching

_NUMBER = {"type": "number"}
JSON_SCHEMAS: dict[str, dict[str, Any]] = {
    "touching": {
        "type": "object",
        "properties": {
            "sample_time_ns": {"type": "integer"},
            "artefact": {"type": ["string", "null"]},
            "feature": {"type": "string"},
        },
        "required": ["sample_time_ns", "artefact", "feature"],
    },
    "conditions": {
        "type": "object",
        "properties": {
            "sample_time_ns": {"type": "integer"},
            "temperature_c": _NUMBER,
            "force_n": _NUMBER,
        },
        "required": ["sample_time_ns"],
    },
}


# Before compression: one second at 1 kHz with seven joints.
CHUNK_BYTES = 1 << 16


class RecordingWriter:
    """Appends to a recording; a context manager.

    What has been written as a whole chunk is in the operating system's hands, and a
    program that dies loses the last chunk only.

    Args:
        path: Written anew.
        joints: Names, from the base outwards.
        arm_text: The arm file in force.
        campaign_text: `campaign.toml`, where it is a campaign's.
        chunk_bytes: Of a chunk before compression.
    """

    def __init__(
        self,
        path: str | Path,
        joints: Sequence[str],
        arm_text: str,
        campaign_text: str | None = None,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        self._joints = tuple(joints)
        self._file = Path(path).open("wb")  # noqa: SIM115 - closed by close()
        self._utc_ns = 0
        self._host_ns = 0
        writer = Writer(self._file, chunk_size=chunk_bytes)
        writer.start(profile=PROFILE, library="traverse")
        names = json.dumps(list(joints))
        writer.add_metadata("traverse", {"schema": SCHEMA, "joints": names})
        texts = {"arm.toml": arm_text, "campaign.toml": campaign_text}
        for name, text in texts.items():
            if text is not None:
                writer.add_attachment(0, 0, name, "application/toml", text.encode())
        self._samples = writer.register_channel("samples", "msgpack", 0)
        self._channels = {
            topic: writer.register_channel(
                topic,
                "json",
                writer.register_schema(
                    f"traverse/recording/{topic}/1",
                    "jsonschema",
                    json.dumps(schema).encode(),
                ),
            )
            for topic, schema in JSON_SCHEMAS.items()
        }
        self._writer = writer
        self._file.flush()

    def add_samples(self, samples: Samples) -> None:
        """Append a block of samples, some hundred at a time.

        Raises:
            ValueError: They are of another number of joints.
        """
        if samples.counts.shape[1] != len(self._joints):
            raise ValueError(
                f"samples of {samples.counts.shape[1]} joints for a recording of "
                f"{len(self._joints)}: {', '.join(self._joints)}"
            )
        if len(samples) == 0:
            return
        self._utc_ns = int(samples.utc_ns[0])
        self._host_ns = int(samples.sample_time_ns[0])
        self._add(self._samples, self._host_ns, samples_to_bytes(samples))

    def add_touching(self, value: Touching) -> None:
        channel = self._channels["touching"]
        self._add(channel, value.sample_time_ns, touching_to_bytes(value))

    def add_conditions(self, value: Conditions) -> None:
        channel = self._channels["conditions"]
        self._add(channel, value.sample_time_ns, conditions_to_bytes(value))

    def close(self) -> None:
        if not self._file.closed:
            self._writer.finish()  # type: ignore[no-untyped-call] # mcap's own
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def _add(self, channel: int, sample_time_ns: int, content: bytes) -> None:
        # Programs that show recordings need UTC; items before any sample get 0.
        log_ns = max(self._utc_ns + sample_time_ns - self._host_ns, 0)
        self._writer.add_message(channel, log_ns, content, log_ns)
        self._file.flush()


def samples_to_bytes(samples: Samples) -> bytes:
    table: dict[str, msgpack.ExtType] = {
        name: _packed(getattr(samples, name).astype(np.int64)) for name in TIMES
    }
    table["counts"] = _packed(samples.counts.astype(np.uint32))
    packed: bytes = msgpack.packb(table)
    return packed


def touching_to_bytes(value: Touching) -> bytes:
    table = {
        "sample_time_ns": value.sample_time_ns,
        "artefact": value.artefact,
        "feature": value.feature,
    }
    return json.dumps(table).encode()


def conditions_to_bytes(value: Conditions) -> bytes:
    """Write the conditions of a moment; unknown values are left out."""
    table: dict[str, float] = {"sample_time_ns": value.sample_time_ns}
    if value.temperature_c is not None:
        table["temperature_c"] = value.temperature_c
    if value.force_n is not None:
        table["force_n"] = value.force_n
    return json.dumps(table, allow_nan=False).encode()


def _packed(array: NDArray[Any]) -> msgpack.ExtType:
    return msgpack.ExtType(ARRAY_CODE, array_to_bytes(array))
