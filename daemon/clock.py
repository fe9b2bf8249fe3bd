"""The host's two clocks: monotonic for work, UTC for messages and files."""

import time


class HostClock:
    """Injected wherever time is read, so that tests can set it."""

    def monotonic_ns(self) -> int:
        """Time that never jumps [ns]."""
        return time.monotonic_ns()

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
