"""Reading recordings, torn ones up to the tear."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata

from traverse.recording.messages import (
    SCHEMA,
    TOPICS,
    bytes_to_conditions,
    bytes_to_samples,
    bytes_to_touching,
)
from traverse.recording.torn import PROFILE, TornRecords
from traverse.recording.values import TIMES, Conditions, Recording, Samples, Touching
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.problems import FileError, Problem


class _Parts:
    """Gathers what the records say."""

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
            self.touching.append(bytes_to_touching(content))
        elif topic == "conditions":
            self.conditions.append(bytes_to_conditions(content))

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
        raise FileError(str(path), [Problem("", message)]) from error
    except ValueError as error:
        raise FileError(str(path), [Problem("", str(error))]) from error


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
