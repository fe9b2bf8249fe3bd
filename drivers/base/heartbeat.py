"""Heartbeats of threads.

A working thread calls `beat` at every turn of its loop, and `idle` before it waits by
design. Without a beat for longer than allowed it is stuck.
"""

import time
from collections.abc import Callable


class Heartbeat:
    """Beaten by one thread, read by another; no lock, since it is one value."""

    def __init__(
        self, name: str, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.name = name
        self._now_ns = monotonic_ns
        self._last_beat: tuple[int, int] | None = None

    def beat(self, allowed_s: float = 0.0) -> None:
        """Note progress; the next step may take ``allowed_s``."""
        self._last_beat = self._now_ns(), int(allowed_s * 1e9)

    def idle(self) -> None:
        """Note that the thread waits for work, or has ended in order."""
        self._last_beat = None

    def overdue_s(self, limit_s: float) -> float | None:
        """Return for how long it has been silent, if longer than allowed [s]."""
        beaten = self._last_beat
        if beaten is None:
            return None
        since_ns, allowed_ns = beaten
        silent_ns = self._now_ns() - since_ns
        return silent_ns * 1e-9 if silent_ns > max(limit_s * 1e9, allowed_ns) else None
