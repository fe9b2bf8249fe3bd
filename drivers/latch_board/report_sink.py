"""How what a latch board says reaches the consumer."""

from collections import Counter
from collections.abc import Callable, Sized
from dataclasses import dataclass

from traverse.drivers.base.values import CountSamples, LatchedCounts


@dataclass(frozen=True, slots=True)
class BoardReports:
    """Where the words of a board go; of one connection.

    Attributes:
        device: id in the configuration.
        n_channels: as HELLO told.
        put: hands a delivery over; False where it has no room.
        fault: tells what was survived: code, text, remedy, how often.
        counters: of the driver.
    """

    device: str
    n_channels: int
    put: Callable[[CountSamples | LatchedCounts], bool]
    fault: Callable[[str, str, str, int], None]
    counters: Counter[str]

    def fits(self, counts: Sized) -> bool:
        """Whether a latch has the channels that HELLO told; else it is counted."""
        if len(counts) == self.n_channels:
            return True
        self.fault(
            "channels_changed",
            f"{len(counts)} channels in a frame of a board with {self.n_channels}",
            "update the board's firmware",
            1,
        )
        return False
