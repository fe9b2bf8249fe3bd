"""A faulty clock: its reading at each true time, and the inverse."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.honesty.plan import Plan
from traverse.arrays import Floats

FAR_S = 1e5


@dataclass(frozen=True, slots=True)
class ClockFault:
    """A clock is stopped or slewed for a time, or is set.

    Attributes:
        rate: that remains of its own meanwhile.
        set_s: by how much it is set ahead; negative: back.
    """

    at_s: float
    stands_s: float = 0.0
    set_s: float = 0.0
    rate: float = 0.0

    def is_at(self, true_s: float) -> bool:
        """Return whether the clock is stopped or slewed."""
        return self.at_s <= true_s < self.at_s + self.stands_s


class Timeline:
    """A polyline of a clock [s] over true time [s].

    Args:
        rate: Seconds of the clock in a second.
        drift_s: Change of the rate in a second, until `drift_until_s`.
        faults: In order of time, not overlapping.
    """

    def __init__(
        self,
        rate: float = 1.0,
        drift_s: float = 0.0,
        drift_until_s: float = 0.0,
        faults: Sequence[ClockFault] = (),
    ) -> None:
        self._even_rate = rate if not faults and not drift_s else 0.0  # without a break
        breaks = {0.0, FAR_S}
        if drift_s:
            breaks.update(np.arange(0.0, drift_until_s, 1.0).tolist())
            breaks.add(drift_until_s)
        for fault in faults:
            breaks.update((fault.at_s, fault.at_s + fault.stands_s))
        self._true: list[float] = []
        self._shown: list[float] = []
        shown_s, before_s = 0.0, 0.0
        for at_s in sorted(breaks):
            middle_s = min(0.5 * (before_s + at_s), drift_until_s)
            left = next((f.rate for f in faults if f.is_at(before_s)), 1.0)
            shown_s += left * (at_s - before_s) * (rate + drift_s * middle_s)
            self._add(at_s, shown_s)
            for fault in faults:
                if fault.set_s and fault.at_s == at_s:
                    shown_s += fault.set_s
                    self._add(at_s, shown_s)
            before_s = at_s
        self._knots = np.array(self._true), np.array(self._shown)

    def _add(self, true_s: float, shown_s: float) -> None:
        self._true.append(true_s)
        self._shown.append(shown_s)

    def at(self, true_s: float) -> float:
        if self._even_rate:
            return true_s * self._even_rate
        return _along(self._true, self._shown, true_s)

    def true(self, shown_s: float) -> float:
        """Return the last true time of a reading; the clock must never be set back."""
        if self._even_rate:
            return shown_s / self._even_rate
        return _along(self._shown, self._true, shown_s)

    def true_array(self, shown_s: Floats) -> Floats:
        true_s: Floats = np.interp(shown_s, self._knots[1], self._knots[0])
        return true_s


def _along(knots: list[float], values: list[float], position: float) -> float:
    place = min(max(bisect_right(knots, position) - 1, 0), len(knots) - 2)
    length = knots[place + 1] - knots[place]
    share = (position - knots[place]) / length if length else 1.0
    return values[place] + share * (values[place + 1] - values[place])


def host_timeline(plan: Plan) -> Timeline:
    stands = [
        ClockFault(f.at_s, stands_s=f.lasts_s)
        for f in plan.faults
        if f.kind == "host_freeze"
    ]
    slews = [
        ClockFault(f.at_s, stands_s=f.lasts_s, rate=1.0 + 1e-6 * f.size)
        for f in plan.faults
        if f.kind == "host_slew"
    ]
    return Timeline(faults=[*stands, *slews])


def device_timeline(plan: Plan, number: int) -> Timeline:
    stands = [
        ClockFault(f.at_s, stands_s=f.lasts_s)
        for f in sorted(plan.faults, key=lambda fault: fault.at_s)
        if f.kind in ("device_stall", "timer_loss") and f.device == number
    ]
    return Timeline(
        1.0 + 1e-6 * plan.rates_ppm[number],
        1e-6 * plan.drifts_ppm_s[number],
        plan.duration_s,
        stands,
    )
