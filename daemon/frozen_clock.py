"""Time for measuring: frozen during a step, so that steps can be repeated.

Whatever is decided by the time, within one step, is decided by the same time. The
relation to UTC is frozen too; it is checked regularly, and adopted where it has
changed by more than jitter.
"""

from collections.abc import Callable

from traverse.daemon.clock import HostClock

LOOK_NS = 1_000_000_000
JITTER_NS = 50_000


class FrozenClock(HostClock):
    """A clock that advances on request.

    Args:
        host: where it gets the time from.
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
        """Advance to the present; return it."""
        now_ns = self._now_ns = self._host.monotonic_ns()
        if now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            offset_ns = self._host.utc_offset_ns()
            if abs(offset_ns - self._utc_offset_ns) > JITTER_NS:
                self._utc_offset_ns = offset_ns
                self._related(now_ns, offset_ns)
        return now_ns

    def monotonic_ns(self) -> int:
        """The time of this step."""
        return self._now_ns

    def utc_offset_ns(self) -> int:
        """What to add to monotonic time to get UTC."""
        return self._utc_offset_ns
