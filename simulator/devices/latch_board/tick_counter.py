"""The board's counter: never stops, wraps at 2^32, and is not quite right."""

import math
from dataclasses import dataclass

from traverse.arrays import Floats, Integers

ROUNDING = 1e-6  # of a tick: `at` of `time_s` must be the same tick again


@dataclass(frozen=True, slots=True)
class TickCounter:
    """A counter in the units of true time.

    Ticks are whole numbers without wrap here, 0 at power-up; `shown` is what a frame
    carries.

    Attributes:
        rate_hz: What the board believes.
        error_ppm: By how much its quartz runs fast.
        first_ticks: What the counter shows at power-up.
        power_up_s: True time of power-up.
    """

    rate_hz: int
    error_ppm: float
    first_ticks: int
    power_up_s: float

    def at(self, time_s: float) -> int:
        """Ticks that have passed at a time."""
        return math.floor((time_s - self.power_up_s) * self._true_rate_hz + ROUNDING)

    def time_s(self, ticks: int) -> float:
        """True time of a tick."""
        return self.power_up_s + ticks / self._true_rate_hz

    def times_s(self, ticks: Integers) -> Floats:
        """True times (n,) of ticks (n,)."""
        return self.power_up_s + ticks / self._true_rate_hz

    def shown(self, ticks: int) -> int:
        """What the 32-bit counter shows."""
        return (self.first_ticks + ticks) & 0xFFFFFFFF

    @property
    def _true_rate_hz(self) -> float:
        return self.rate_hz * (1.0 + 1e-6 * self.error_ppm)
