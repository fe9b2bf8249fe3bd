"""The flight recorder: the last minutes in segments, and recordings kept of them.

A segment begins with a state, so that it can be replayed alone. A kept recording is one
file of all segments.
"""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.recorder.file import check_room
from traverse.recording.run_reader import RunReader
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.strict_toml.ownership import reason_of_owner

SEGMENT_NS = 10_000_000_000
FOLDER = "flight"
SEGMENT = "segment-*.mcap"
KEPT = "flight-*.mcap"
RETRY_S = 30.0


def reason_of(error: Exception) -> str:
    if owner := reason_of_owner(error):
        return owner
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or repr(error)


@dataclass(eq=False)
class FlightRecorder:
    """Writes segments, and drops the oldest beyond a time and a size.

    After an error of the disk it pauses: calls go through `use`, except `end_segment`,
    `retry` and `abandon`. Used by the recorder thread alone.

    Args:
        folder: of all recordings; made if missing.
        about: values for the head of every file.
        on_failure: called with the reason when a failure begins, with "" at its end.
        on_kept: called with each file kept after a fault.

    Attributes:
        kept, dropped: files kept after faults, and older ones dropped for them.
        n_bytes: written since the start.
    """

    folder: Path
    section: RecordingSection
    about: Mapping[str, str]
    on_failure: Callable[[str], None]
    on_kept: Callable[[Path], None]

    def __post_init__(self) -> None:
        self._retry_s: float | None = None
        self._segments = self.folder / FOLDER
        self._writer: RunWriter | None = None
        self._begun_ns = 0
        self.kept = 0
        self.dropped = 0
        self.n_bytes = 0

    def use(self, act: Callable[["FlightRecorder"], object]) -> None:
        if not self.section.flight or self._retry_s is not None:
            return
        try:
            act(self)
        except OSError as error:
            self.abandon()
            self._retry_s = time.monotonic() + RETRY_S
            self.on_failure(reason_of(error))

    def recover_crashed(self) -> None:
        """Keep the segments of a crashed daemon; remove all others."""
        self._segments.mkdir(mode=0o700, parents=True, exist_ok=True)
        segments = self._found()
        if segments and not _is_whole(segments[-1]):
            self.keep("crash")
        for segment in self._found():
            segment.unlink(missing_ok=True)

    def begin_segment(
        self, at_ns: int, utc_ns: int, files: Mapping[str, bytes]
    ) -> None:
        if self._writer is not None and at_ns - self._begun_ns < SEGMENT_NS:
            return
        self.close()
        path = self._segments / f"segment-{utc_ns:020d}.mcap"
        head = RunHead({**self.about, "cause": "flight"}, files)
        self._writer, self._begun_ns = RunWriter(path, head), at_ns
        self._delete_old(utc_ns)

    def end_segment(self) -> None:
        self._begun_ns = -SEGMENT_NS

    def add(self, entry: Entry) -> None:
        """Append a message, except of scans, which can be computed."""
        if self._writer is not None and entry.topic != "cloud":
            self._writer.add(entry)
            self.n_bytes += len(entry.content)

    def attach(self, files: Mapping[str, bytes]) -> None:
        if self._writer is not None:
            self._writer.attach(files)

    def flush(self) -> None:
        check_room(self.folder, self.section)
        self._flush()

    def close(self) -> None:
        if self._writer is not None:
            writer, self._writer = self._writer, None
            writer.close(sync=self.section.sync)

    def retry(self, now_s: float) -> None:
        """Resume after a pause; the next state begins a segment."""
        if self._retry_s is not None and now_s >= self._retry_s:
            self._retry_s = None
            self.on_failure("")

    def abandon(self) -> None:
        """Leave everything as it is, after a failure."""
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None

    def _flush(self) -> None:
        if self._writer is not None:
            self._writer.flush(sync=self.section.sync)

    def keep(self, why: str) -> None:
        """Join all segments into one kept file; the oldest kept one may be dropped."""
        self._flush()
        segments = self._found()
        if not segments:
            return
        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")
        path = self.folder / f"flight-{now}Z-{why}.mcap"
        part = path.with_suffix(".part")
        try:
            _join(segments, part, {**self.about, "cause": why})
            part.rename(path)
        finally:
            part.unlink(missing_ok=True)
        self.kept += 1
        for old in sorted(self.folder.glob(KEPT))[: -self.section.kept]:
            old.unlink(missing_ok=True)
            self.dropped += 1
        self.on_kept(path)

    def _found(self) -> list[Path]:
        return sorted(self._segments.glob(SEGMENT))

    def _delete_old(self, utc_ns: int) -> None:
        *older, newest = self._found()
        oldest_ns = utc_ns - int(self.section.flight_s * 1e9)
        room = (self.section.flight_mb << 20) - newest.stat().st_size
        is_old, follower = False, newest
        for segment in reversed(older):
            room -= segment.stat().st_size
            is_old |= int(follower.stem.removeprefix("segment-")) < oldest_ns
            if is_old or room < 0:
                segment.unlink(missing_ok=True)
            follower = segment


def _is_whole(segment: Path) -> bool:
    try:
        with RunReader(segment) as reader:
            for _ in reader:
                pass
            return reader.tear is None
    except ValueError:
        return False


def _join(segments: list[Path], path: Path, about: Mapping[str, str]) -> None:
    """Join recordings into one, up to the tear of each."""
    writer: RunWriter | None = None
    files: dict[str, bytes] = {}
    try:
        for segment in segments:
            # What a crash left may have been torn within its head.
            with suppress(ValueError), RunReader(segment) as reader:
                if writer is None:
                    head = {**reader.about, **about, "version": reader.about["version"]}
                    files = dict(reader.files)
                    writer = RunWriter(path, RunHead(head, files))
                for entry in reader:
                    for name, content in reader.files.items():
                        if files.get(name) != content:
                            files[name] = content
                            writer.attach({name: content})
                    writer.add(entry)
    except BaseException:
        if writer is not None:
            writer.abandon()
        raise
    if writer is None:
        raise OSError("no segment can be read")
    writer.close(sync=True)
