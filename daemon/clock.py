"""The host's two clocks: monotonic for work, UTC for messages and files."""

import time
from collections.abc import Callable

LOOK_NS = 1_000_000_000
JITTER_NS = 50_000
STEP_NS = 10_000_000  # UTC that moves by more was set, not adjusted gradually


class HostClock:
    """Injected wherever time is read, so that tests can set it."""

    def monotonic_ns(self) -> int:
        """Time that never jumps [ns]."""
        return time.monotonic_ns()

    def elapsed_ns(self) -> int:
        """Time that never jumps and counts while the computer is suspended, too."""
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)

    def utc_offset_ns(self) -> int:
        """What to add to monotonic time to get nanoseconds since 1970, UTC."""
        return time.time_ns() - time.monotonic_ns()

    def to_utc_ns(self, monotonic_ns: int) -> int:
        """UTC of a monotonic time, by the present relation of the two."""
        return monotonic_ns + self.utc_offset_ns()

    def step(self) -> int:
        """Advance to the present, where time is stepped; return it [ns]."""
        return self.monotonic_ns()

    @property
    def running(self) -> "HostClock":
        """The running clock, for durations."""
        return self


class FrozenClock(HostClock):
    """Time for measuring: frozen during a step, so that steps can be repeated.

    Whatever is decided by the time, within one step, is decided by the same time. The
    relation to UTC is frozen too; it is checked regularly, and adopted where it has
    changed by more than jitter; a step of it at once.

    Args:
        related: called with (now_ns, utc_offset_ns) when the relation to UTC changes.
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
        """The running clock."""
        return self._host

    def step(self) -> int:
        """Go on to the present; gives it."""
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
        """The time of this step."""
        return self._now_ns

    def utc_offset_ns(self) -> int:
        """What to add to monotonic time to get UTC."""
        return self._utc_offset_ns
