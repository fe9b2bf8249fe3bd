"""Reading recordings, torn ones up to the tear.

`samples` are MessagePack maps with arrays as on MQTT (`traverse.protocol.arrays`);
`touching` and `conditions` are JSON. Unknown keys are passed over: later recorders may
say more.
"""

import json
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from traverse.recording.maps import bytes_to_map
from traverse.recording.torn import PROFILE, TornRecords
from traverse.recording.values import TIMES, Conditions, Recording, Samples, Touching
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.problems import FileError, problem_from_error

SCHEMA = "traverse/recording/1"
TOPICS = ("samples", "touching", "conditions")
_TOUCHING, _CONDITIONS = TypeAdapter(Touching), TypeAdapter(Conditions)
T = TypeVar("T")


def bytes_to_samples(content: bytes, n_joints: int) -> Samples:
    """Read a block of samples; raises ValueError if it is malformed."""
    try:
        table = bytes_to_map(content)
    except ValueError as error:
        raise ValueError(f"samples: {error}") from error
    missing = [name for name in (*TIMES, "counts") if name not in table]
    if missing:
        raise ValueError(f"samples: {', '.join(missing)} missing; expected arrays")
    counts = _integers(table, "counts")
    if counts.ndim != 2 or counts.shape[1] != n_joints:
        raise ValueError(
            f"samples: counts have shape {counts.shape}, expected (n, {n_joints})"
        )
    if counts.size and not 0 <= int(counts.min()) <= int(counts.max()) < 2**32:
        raise ValueError("samples: counts are outside 0 to 2^32 - 1")
    times = {name: _integers(table, name).astype(np.int64) for name in TIMES}
    return Samples(**times, counts=counts.astype(np.uint32))


def _integers(table: dict[str, Any], key: str) -> NDArray[Any]:
    array = table[key]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iu":
        raise ValueError(f"samples: {key} is no array of integers")
    return array


def _from_json(topic: str, content: bytes, kind: TypeAdapter[T]) -> T:
    try:
        return kind.validate_json(content, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{topic}: {problem_from_error(first, ())}") from error


class _Parts:
    def __init__(self) -> None:
        self.joints: tuple[str, ...] | None = None
        self.texts: dict[str, str] = {}
        self.topics: dict[int, str] = {}
        self.blocks: list[Samples] = []
        self.touching: list[Touching] = []
        self.conditions: list[Conditions] = []

    def add(self, record: McapRecord) -> None:
        if isinstance(record, Header) and record.profile != PROFILE:
            raise ValueError(
                f"profile is {record.profile!r}, expected {PROFILE!r}; was it recorded "
                "by another program?"
            )
        if isinstance(record, Metadata) and record.name == "traverse":
            self.joints = _joints(record.metadata)
        elif isinstance(record, Attachment):
            self.texts[record.name] = record.data.decode()
        elif isinstance(record, Channel) and record.topic in TOPICS:
            self.topics[record.id] = record.topic
        elif isinstance(record, Message):
            self._add_message(self.topics.get(record.channel_id), record.data)

    def _add_message(self, topic: str | None, content: bytes) -> None:
        if topic == "samples":
            if self.joints is None:
                raise ValueError("samples come before the metadata `traverse`")
            self.blocks.append(bytes_to_samples(content, len(self.joints)))
        elif topic == "touching":
            self.touching.append(_from_json(topic, content, _TOUCHING))
        elif topic == "conditions":
            self.conditions.append(_from_json(topic, content, _CONDITIONS))

    def recording(self, tear: str | None) -> Recording:
        after = "" if tear is None else f" before the tear ({tear})"
        if self.joints is None:
            raise ValueError(f"no metadata `traverse`{after}; expected the joints")
        if "arm.toml" not in self.texts:
            raise ValueError(f"no attachment arm.toml{after}; expected the arm file")
        if not self.blocks:
            raise ValueError(f"no samples{after}; expected some")
        samples = _joined(self.blocks)
        rising = np.diff(samples.sample_time_ns) > 0
        if not np.all(rising):
            row = int(np.argmin(rising)) + 1
            raise ValueError(
                f"sample {row + 1} of {len(samples)} is not later than the one before "
                f"({int(samples.sample_time_ns[row])} ns); expected rising times"
            )
        return Recording(
            joints=self.joints,
            arm_text=self.texts["arm.toml"],
            campaign_text=self.texts.get("campaign.toml"),
            samples=samples,
            touching=tuple(sorted(self.touching, key=lambda t: t.sample_time_ns)),
            conditions=tuple(sorted(self.conditions, key=lambda c: c.sample_time_ns)),
            tear=tear,
        )


def read_recording(path: str | Path) -> Recording:
    """Read a recording, an MCAP file; chunks are checked by their CRC.

    What is torn off at its end is missing in the result, and `tear` is the place.

    Raises:
        FileError: It is no recording, or breaks a rule of its own.
    """
    parts = _Parts()
    try:
        with open_regular(Path(path)) as file:
            records = TornRecords(file)
            for record in records:
                parts.add(record)
        return parts.recording(records.tear)
    except OSError as error:
        reason = error.strerror or str(error)
        message = f"cannot be read: {reason}; check the path"
        raise FileError(path, message) from error
    except ValueError as error:
        raise FileError(path, str(error)) from error


def _joints(table: dict[str, str]) -> tuple[str, ...]:
    if table.get("schema") != SCHEMA:
        raise ValueError(f"schema is {table.get('schema')!r}, expected {SCHEMA!r}")
    names: Any = None
    try:
        names = json.loads(table.get("joints", ""))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"joints are not JSON: {error}") from error
    if (
        not isinstance(names, list)
        or not names
        or not all(isinstance(name, str) for name in names)
    ):
        raise ValueError(f"joints are {names!r}, expected a list of names")
    return tuple(names)


def _joined(blocks: list[Samples]) -> Samples:
    times = {n: np.concatenate([getattr(b, n) for b in blocks]) for n in TIMES}
    return Samples(**times, counts=np.concatenate([b.counts for b in blocks]))
