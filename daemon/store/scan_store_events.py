"""What is told of the spool of scans."""

from pathlib import Path

from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.store.records import StorageError


class ScanStoreEvents:
    """Tells how it is.

    Args:
        path: of the spool.
        events: where it is told.
    """

    def __init__(self, path: Path, events: EventLog) -> None:
        self._path = path
        self._events = events

    def full(self, is_full: bool, spool_mb: float) -> None:
        """Whether there is no room for blocks."""
        self._events.change(
            is_full,
            "error",
            "scan.spool_full",
            f"{self._path} holds {spool_mb:g} MB of scans that the "
            "broker lacks; further blocks are dropped"
            if is_full
            else "there is room for scans again",
            source="scan",
            remedy="bring the broker back, or raise spool_mb of [scan]"
            if is_full
            else "",
        )

    def trouble(self, trouble: StorageError | None) -> None:
        """Why blocks cannot be kept; None where they can."""
        self._events.change(
            trouble is not None,
            "error",
            "scan.spool_failed",
            "scans are kept again"
            if trouble is None
            else f"scans are sent without having been kept: {trouble.text}",
            source="scan",
            remedy="" if trouble is None else trouble.remedy,
        )

    def replaced(self, text: str) -> None:
        """A new database has been begun."""
        self._events.report("error", "scan.spool_replaced", text, source="scan")
