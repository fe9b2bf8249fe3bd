"""Clocks of the host: monotonic for work, UTC for messages and files."""

import time
from collections.abc import Callable

LOOK_NS = 1_000_000_000
JITTER_NS = 50_000
STEP_NS = 10_000_000  # UTC that moves by more was set, not adjusted gradually


class HostClock:
    """System clocks, passed to everything that reads time."""

    def monotonic_ns(self) -> int:
        return time.monotonic_ns()

    def elapsed_ns(self) -> int:
        """Return monotonic time that includes suspension [ns]."""
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)

    def utc_offset_ns(self) -> int:
        """Return UTC since 1970 minus monotonic time [ns]."""
        return time.time_ns() - time.monotonic_ns()

    def to_utc_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns + self.utc_offset_ns()

    def step(self) -> int:
        """Advance a stepped clock to the present; return it [ns]."""
        return self.monotonic_ns()

    @property
    def running(self) -> "HostClock":
        return self


class FrozenClock(HostClock):
    """Clock that stands still within a step, so that steps can be repeated.

    The offset to UTC is frozen too. It is checked regularly and adopted when it differs
    by more than jitter; at once when the clock was set.

    Args:
        related: called with (now_ns, utc_offset_ns) when the offset changes.
    """

    def __init__(
        self,
        host: HostClock,
        related: Callable[[int, int], None] = lambda now_ns, utc_offset_ns: None,
    ) -> None:
        self._host = host
        self._related = related
        self._now_ns = host.monotonic_ns()
        self._utc_offset_ns = host.utc_offset_ns()
        self._looked_ns = self._now_ns

    @property
    def running(self) -> HostClock:
        return self._host

    def step(self) -> int:
        now_ns = self._now_ns = self._host.monotonic_ns()
        offset_ns, limit_ns = self._host.utc_offset_ns(), STEP_NS
        if now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns, limit_ns = now_ns, JITTER_NS
        if -limit_ns <= offset_ns - self._utc_offset_ns <= limit_ns:
            return now_ns
        if self._change_ns(offset_ns) > STEP_NS:
            # Not if this thread only had to wait between its two readings.
            offset_ns = min(offset_ns, self._host.utc_offset_ns(), key=self._change_ns)
        if self._change_ns(offset_ns) > limit_ns:
            self._utc_offset_ns = offset_ns
            self._related(now_ns, offset_ns)
        return now_ns

    def _change_ns(self, utc_offset_ns: int) -> int:
        return abs(utc_offset_ns - self._utc_offset_ns)

    def monotonic_ns(self) -> int:
        return self._now_ns

    def utc_offset_ns(self) -> int:
        return self._utc_offset_ns
