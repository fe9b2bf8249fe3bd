"""What is told of recordings."""

from pathlib import Path

from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.recorder.manual_recording import Recorded

SOURCE = "recording"


class RecorderEventReporter:
    """Tells it.

    Args:
        events: where.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events

    def started(self, path: Path) -> None:
        """A recording has begun."""
        text = f"{path} is being recorded"
        self._events.report("info", "recording.started", text, source=SOURCE)

    def stopped(self, recorded: Recorded | None, why: str, *, by_itself: bool) -> None:
        """A recording has ended."""
        what = "the recording" if recorded is None else str(recorded.path)
        remedy = "what is in it can be read; make room, then record again"
        self._events.report(
            "error" if by_itself else "info",
            "recording.stopped",
            f"{what} has ended: {why}",
            source=SOURCE,
            remedy=remedy if by_itself else "",
            distinct=True,
        )

    def kept(self, path: Path) -> None:
        """The last minutes are safe."""
        text = f"the last minutes are kept in {path}"
        self._events.report(
            "info", "recording.kept", text, source=SOURCE, distinct=True
        )

    def flight_failed(self, reason: str) -> None:
        """The flight recorder cannot write; or, for no reason, tries again."""
        self._events.change(
            bool(reason),
            "error",
            "recording.failed",
            f"the flight recorder cannot write: {reason}"
            if reason
            else "the flight recorder tries again",
            source=SOURCE,
            remedy="make room on the disk; measuring goes on without it",
        )

    def overflow(self) -> None:
        """There was no room in the queue."""
        self._events.report(
            "warning",
            "recording.overflow",
            "the disk does not keep up with what is to be recorded; a part of it is "
            "left out",
            source=SOURCE,
            remedy="record to a faster disk, or at a lower rate",
        )
