"""The condition of the computer's clock."""

from dataclasses import dataclass

from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import HOST

EARLIEST_UTC_NS = 1_600_000_000_000_000_000  # in 2020, before this was made


@dataclass(eq=False)
class UtcCondition:
    """Feeds the condition `utc`.

    Attributes:
        doubt, remedy: why UTC cannot be believed, and what to do; empty if it can.
    """

    clock: HostClock
    conditions: ConditionMonitor
    doubt: str = ""
    remedy: str = ""

    def check(self) -> None:
        """Compare the clock again; call at each step."""
        if self.doubt:
            self.conditions.doubt("utc", HOST, self.doubt, remedy=self.remedy)
        elif self.clock.monotonic_ns() + self.clock.utc_offset_ns() >= EARLIEST_UTC_NS:
            self.conditions.establish("utc", HOST)
        else:
            self.conditions.doubt("utc", HOST, "the computer's clock is years behind")
