"""Parts of a recording: messages, the seconds before it, the file."""

import errno
import shutil
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.recorder.item_queue import WARM_UP_NS, RecorderItem
from traverse.drivers.base.delivery_maps import delivery_to_map
from traverse.protocol.messages import Event, Point, Scan
from traverse.recording.maps import map_to_bytes
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.recording.views import (
    cloud_to_bytes,
    log_to_bytes,
    point_to_bytes,
    pose_to_bytes,
)

STEPS = "steps"
MOST_BYTES = 32 << 20


def entries_of(item: RecorderItem, utc_offset_ns: int) -> Iterator[Entry]:
    """Yield the messages of an item; ``utc_offset_ns`` converts monotonic time."""
    message, log_ns = item.value, item.at_ns + utc_offset_ns
    if item.kind == "published":
        match message:
            case Point():
                yield Entry("point", log_ns, point_to_bytes(message))
                if message.retracts is None:
                    yield Entry("pose", log_ns, pose_to_bytes(message))
            case Scan():
                yield Entry("cloud", log_ns, cloud_to_bytes(message))
            case Event():
                yield Entry("log", log_ns, log_to_bytes(message))
        return
    if item.kind == "delivered":
        topic = f"device/{item.value.device}/{item.name}"
        table = {"at_ns": item.at_ns, **delivery_to_map(item.value)}
    else:
        topic = STEPS
        table = {"at_ns": item.at_ns, "is": item.kind}
        if item.name:
            table["what"] = item.name
        if item.value is not None:
            table["value"] = item.value
    yield Entry(topic, log_ns, map_to_bytes(table))


@dataclass(slots=True)
class _Segment:
    """Items since a state: bytes of all messages, and their ends."""

    begun_ns: int
    content: bytearray = field(default_factory=bytearray)
    ends: list[tuple[str, int, int]] = field(default_factory=list)

    def add(self, entry: Entry) -> None:
        self.content += entry.content
        self.ends.append((entry.topic, entry.log_ns, len(self.content)))

    def __iter__(self) -> Iterator[Entry]:
        begin = 0
        for topic, log_ns, end in self.ends:
            yield Entry(topic, log_ns, bytes(self.content[begin:end]))
            begin = end


class PreTriggerBuffer:
    """Messages since the last state old enough to start a recording.

    Their bytes are concatenated: stored one by one for seconds among short-lived
    objects, they would fragment the heap.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._segments: deque[_Segment] = deque()
        self._n_bytes = 0

    def begin_segment(self, at_ns: int) -> None:
        """Begin a segment; the next message is a state."""
        segments = self._segments
        segments.append(_Segment(at_ns))
        while len(segments) > 1 and segments[1].begun_ns <= at_ns - WARM_UP_NS:
            self._drop_oldest()

    def add(self, entry: Entry) -> None:
        """Append a message, except of scans and before the first state."""
        if entry.topic == "cloud" or not self._segments:
            return
        self._segments[-1].add(entry)
        self._n_bytes += len(entry.content)
        while self._n_bytes > self._most_bytes and self._segments:
            self._drop_oldest()

    def clear(self) -> None:
        self._segments.clear()
        self._n_bytes = 0

    def __iter__(self) -> Iterator[Entry]:
        for segment in self._segments:
            yield from segment

    def __bool__(self) -> bool:
        return bool(self._segments)

    def _drop_oldest(self) -> None:
        self._n_bytes -= len(self._segments.popleft().content)


@dataclass(frozen=True, slots=True)
class Recorded:
    """Figures of a recording.

    Attributes:
        n_bytes: length of the file.
        gaps: how often something is missing.
    """

    name: str
    path: Path
    n_bytes: int
    messages: int
    seconds: float
    gaps: int


class ManualRecording:
    """Writes a recording that was requested by name.

    Args:
        path: of the new file.
        before: the seconds before the request.

    Attributes:
        gaps: how often something is missing.

    Raises:
        OSError: from all methods: it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        section: RecordingSection,
        head: RunHead,
        before: Iterable[Entry],
    ) -> None:
        check_room(path.parent, section)
        if path.exists():
            raise FileExistsError(f"{path} is there already")
        self._name = name
        self._section = section
        self._begun_s = time.monotonic()
        self.gaps = 0
        self.writer = RunWriter(path, head)
        for entry in before:
            self.writer.add(entry)
        self.writer.flush()

    @property
    def recorded(self) -> Recorded:
        return Recorded(
            self._name,
            self.writer.path,
            self.writer.path.stat().st_size,
            self.writer.n_messages,
            time.monotonic() - self._begun_s,
            self.gaps,
        )

    def flush(self) -> None:
        """Flush to the operating system, or to the disk.

        Raises:
            OSError: it cannot be written, or is too long.
        """
        check_room(self.writer.path.parent, self._section)
        self.writer.flush(sync=self._section.sync)
        if self.writer.n_bytes > self._section.max_mb << 20:
            raise OSError(f"it is longer than max_mb, {self._section.max_mb} MB")

    def close(self) -> Recorded:
        self.writer.close(sync=True)
        return self.recorded


def check_room(folder: Path, section: RecordingSection) -> None:
    """Check that the disk keeps room for others, above all the outbox.

    Raises:
        OSError: there is too little, or the folder cannot be made.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    free_mb = shutil.disk_usage(folder).free >> 20
    if free_mb < section.min_free_mb:
        raise OSError(
            errno.ENOSPC,
            f"only {free_mb} MB are free; min_free_mb of [recording] is "
            f"{section.min_free_mb}",
        )
