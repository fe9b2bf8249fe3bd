"""The time that the simulator lives by, given to it from outside."""

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds from an arbitrary origin."""

    def now_s(self) -> float:
        """The time."""


class MonotonicClock:
    """The host's monotonic clock, from 0 at its making.

    Attributes:
        origin_ns: The host's monotonic clock at 0.
    """

    def __init__(self) -> None:
        self.origin_ns = time.monotonic_ns()

    def now_s(self) -> float:
        """The time."""
        return 1e-9 * (time.monotonic_ns() - self.origin_ns)
