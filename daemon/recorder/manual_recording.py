"""A recording that somebody has asked for: one file with a name."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from traverse.daemon.config.schema import RecordingSection
from traverse.recording.run_writer import Entry, RunHead, RunWriter


@dataclass(frozen=True, slots=True)
class Recorded:
    """What there is of a recording.

    Attributes:
        path: of the file.
        n_bytes: how long the file is.
        messages: how many it has.
        seconds: how long it took.
        gaps: how often something is missing in it.
    """

    name: str
    path: Path
    n_bytes: int
    messages: int
    seconds: float
    gaps: int


class ManualRecording:
    """Writes one.

    Args:
        path: of the file; it must not be there yet.
        name: what it is called.
        section: of the configuration.
        head: what stands at its beginning.
        before: the seconds before it was asked for.

    Raises:
        OSError: it cannot be written; from all methods.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        section: RecordingSection,
        head: RunHead,
        before: Iterable[Entry],
    ) -> None:
        if path.exists():
            raise FileExistsError(f"{path} is there already")
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._name = name
        self._section = section
        self._begun_s = time.monotonic()
        self._messages = 0
        self._gaps = 0
        self._writer = RunWriter(path, head)
        for entry in before:
            self.add(entry)
        self._writer.flush()

    @property
    def recorded(self) -> Recorded:
        """What there is of it so far."""
        return Recorded(
            self._name,
            self._writer.path,
            self._writer.path.stat().st_size,
            self._messages,
            time.monotonic() - self._begun_s,
            self._gaps,
        )

    def add(self, entry: Entry) -> None:
        """Record a message."""
        self._writer.add(entry)
        self._messages += 1

    def record_gap(self) -> None:
        """Something is missing from here on, which is told in the file."""
        self._gaps += 1

    def attach(self, name: str, content: bytes) -> None:
        """Add a file that is in force from now on."""
        self._writer.attach(name, content)

    def flush(self) -> None:
        """Hand all to the operating system, or to the disk.

        Raises:
            OSError: it cannot be written, or has become too long.
        """
        self._writer.flush(sync=self._section.sync)
        if self._writer.n_bytes > self._section.max_mb << 20:
            raise OSError(f"it is longer than max_mb, {self._section.max_mb} MB")

    def close(self) -> Recorded:
        """Finish the file; gives what it has become."""
        self._writer.close(sync=True)
        return self.recorded

    def abandon(self) -> None:
        """Leave it as it is, after a failure."""
        self._writer.abandon()


def recording_head(
    about: Mapping[str, str], files: Mapping[str, bytes], **more: str
) -> RunHead:
    """What stands at the beginning of a recording with a name."""
    return RunHead({**about, **more, "cause": "asked"}, files)
