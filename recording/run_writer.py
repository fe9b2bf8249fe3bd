"""Writer of a daemon's recording: MCAP in small chunks, so that a crash costs little.

Steps are MessagePack maps, one channel for each topic; points, poses, clouds and log
lines are JSON with schemas (`traverse.recording.views`).
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from mcap.writer import Writer

from traverse.recording.torn import PROFILE
from traverse.recording.views import VIEW_NAMES, VIEW_SCHEMAS

SCHEMA = "traverse/run/1"
OF_FILE = "file "
"""Beginning of the names of metadata with the digests of attachments."""
CHUNK_BYTES = 1 << 20
OWNER_ONLY = 0o600


@dataclass(frozen=True, slots=True)
class Entry:
    """One message of a recording.

    Attributes:
        topic: Its kind.
        log_ns: When, in ns since 1970 UTC.
        content: MessagePack or JSON, by the topic.
    """

    topic: str
    log_ns: int
    content: bytes


@dataclass(frozen=True, slots=True)
class RunHead:
    """The head of a recording.

    Attributes:
        about: Names and values, all texts: arm, version, kernel, name, note, cause.
        files: Arm file, configuration and so on, by the names they had.
    """

    about: Mapping[str, str]
    files: Mapping[str, bytes] = field(default_factory=dict)


class RunWriter:
    """Appends to a recording; a context manager.

    What has been flushed is in the operating system's hands, and on the disk where it
    was flushed with ``sync``.

    Args:
        path: Written anew, for its owner alone.

    Raises:
        OSError: It cannot be written, from here and from all methods.
    """

    def __init__(
        self, path: Path, head: RunHead, chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self.path = path
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        self._file = os.fdopen(os.open(path, flags, OWNER_ONLY), "wb")
        self._channels: dict[str, int] = {}
        self.n_messages = 0
        self._writer = Writer(self._file, chunk_size=chunk_bytes)
        try:
            self._writer.start(profile=PROFILE, library="traverse")
            about = {"schema": SCHEMA, **head.about}
            self._writer.add_metadata("traverse", about)
            self.attach(head.files)
        except BaseException:
            self._file.close()
            raise

    @property
    def n_bytes(self) -> int:
        return self._file.tell() if not self._file.closed else 0

    def add(self, entry: Entry) -> None:
        channel = self._channels.get(entry.topic)
        if channel is None:
            channel = self._channels[entry.topic] = self._channel(entry.topic)
        log_ns = max(entry.log_ns, 0)
        self.n_messages += 1
        self._writer.add_message(
            channel, log_ns, entry.content, log_ns, self.n_messages
        )

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Append files, after all messages so far."""
        self._writer.flush()  # type: ignore[no-untyped-call] # mcap's own
        for name, content in files.items():
            self._writer.add_attachment(0, 0, name, "application/octet-stream", content)
            about = {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
            self._writer.add_metadata(f"{OF_FILE}{name}", about)
        self._file.flush()

    def flush(self, *, sync: bool = False) -> None:
        """End the chunk, and hand all to the operating system, or to the disk."""
        self._writer.flush()  # type: ignore[no-untyped-call] # mcap's own
        if sync:
            os.fdatasync(self._file.fileno())

    def close(self, *, sync: bool = False) -> None:
        if self._file.closed:
            return
        try:
            self._writer.finish()  # type: ignore[no-untyped-call] # mcap's own
            self._file.flush()
            if sync:
                os.fdatasync(self._file.fileno())
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, after a failure."""
        try:
            self._file.close()
        except OSError:  # what could not be written before cannot be now
            return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def _channel(self, topic: str) -> int:
        schema = VIEW_SCHEMAS.get(topic)
        if schema is None:
            return self._writer.register_channel(topic, "msgpack", 0)
        text = json.dumps(schema).encode()
        number = self._writer.register_schema(VIEW_NAMES[topic], "jsonschema", text)
        return self._writer.register_channel(topic, "json", number)
