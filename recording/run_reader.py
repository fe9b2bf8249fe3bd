"""Reader of a daemon's recording, message by message, up to the tear."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata

from traverse.recording.run_writer import OF_FILE, SCHEMA, Entry
from traverse.recording.torn import TornRecords
from traverse.strict_toml.files import open_regular


class RunReader:
    """Goes through a recording once; a context manager.

    Args:
        path: An MCAP file that `traverse.recording.run_writer` has written.

    Attributes:
        files: By name: of the head, and those attached so far.

    Raises:
        ValueError: It is no such recording, or a file in it is damaged.
        OSError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.about: dict[str, str] = {}
        self.files: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        self._number = 0  # of the last message; none in older files
        self._gap: str | None = None
        self._file = open_regular(path)
        try:
            self._records = TornRecords(self._file)
            self._rest = iter(self._records)
            self._first = self._next()
            if self.about.get("schema") != SCHEMA:
                schema = self.about.get("schema")
                raise ValueError(
                    f"{path}: schema is {schema!r}, expected {SCHEMA!r}; was it "
                    "recorded by the daemon?"
                )
        except BaseException as error:
            self._file.close()
            if isinstance(error, ValueError) and str(path) not in str(error):
                raise ValueError(f"{path}: {error}") from error
            raise

    @property
    def tear(self) -> str | None:
        """Why the messages ended before the file did, or None."""
        return self._gap or self._records.tear

    def __iter__(self) -> Iterator[Entry]:
        """Iterate over the messages.

        Raises:
            ValueError: A file in it is damaged.
        """
        entry = self._first
        while entry is not None:
            yield entry
            entry = self._next()

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def _next(self) -> Entry | None:
        for record in self._rest:
            if isinstance(record, Message):
                numbered = self._number or record.sequence
                if numbered and record.sequence != self._number + 1:
                    jump = f"message {record.sequence} follows message {self._number}"
                    self._gap = f"torn where {jump}"
                    return None
                self._number = record.sequence
                topic = self._topics.get(record.channel_id)
                if topic is not None:
                    return Entry(topic, record.log_time, record.data)
            else:
                self._note(record)
        return None

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Channel):
            self._topics[record.id] = record.topic
        elif isinstance(record, Attachment):
            self.files[record.name] = record.data
        elif isinstance(record, Metadata) and record.name == "traverse":
            self.about = dict(record.metadata)
        elif isinstance(record, Metadata) and record.name.startswith(OF_FILE):
            name = record.metadata.get("name", "")
            digest = hashlib.sha256(self.files.get(name, b"")).hexdigest()
            if digest != record.metadata.get("sha256"):
                raise ValueError(f"{self.path}: its file {name!r} is damaged")
