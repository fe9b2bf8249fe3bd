"""A device's clock with errors.

It counts the periods of a resonator or a crystal: its rate is off and changes with the
temperature; its program may lose counts while interrupts are blocked, or with every
page that it writes; it may stop for ever.
"""

from functools import cached_property

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.strict_toml.reader import StrictModel

HALVINGS = 60  # a day to less than a nanosecond
FOREVER_S = 1e12
ROUNDING_S = 1e-11  # far below a tick


class ClockTable(StrictModel):
    """Errors of a device's clock; times are true ones since power-up.

    Attributes:
        error_ppm: by how much it runs fast.
        drift_ppm_per_s: change of that, as while a board warms up,
        lost_every_s: with every such period, it stands still
        lost_s: for so long at its end.
        steps: `[at_s, by_s]` each: it jumps ahead, or, by less than 0, stands still for
            so long.
        stops_at_s: it stands still for ever.
    """

    error_ppm: float = Field(default=0.0, ge=-100_000.0, le=100_000.0)
    drift_ppm_per_s: float = Field(default=0.0, ge=-1000.0, le=1000.0)
    drift_s: float = Field(default=60.0, ge=0.0, le=600.0)
    lost_every_s: float = Field(default=1.0, gt=0.0)
    lost_s: float = Field(default=0.0, ge=0.0)
    steps: tuple[tuple[float, float], ...] = Field(default=(), max_length=1000)
    stops_at_s: float | None = Field(default=None, ge=0.0)


class WrongClock:
    """Readings of a device's clock [s] at true times since power-up [s].

    Args:
        error_ppm: by how much it runs fast besides.
    """

    def __init__(self, table: ClockTable | None = None, error_ppm: float = 0.0) -> None:
        self._table = table or ClockTable()
        self._rate = 1.0 + 1e-6 * (error_ppm + self._table.error_ppm)

    @cached_property
    def is_steady(self) -> bool:
        """Whether its rate is constant, and it loses nothing."""
        table = self._table
        drifts = table.drift_ppm_per_s and table.drift_s
        return not (
            drifts or table.lost_s or table.steps or table.stops_at_s is not None
        )

    @cached_property
    def _standstills(self) -> list[tuple[float, float]]:
        """Begin and end [s] of standstills by `steps`, overlapping ones joined."""
        merged: list[tuple[float, float]] = []
        for at_s, by_s in sorted(self._table.steps):
            if by_s >= 0.0:
                continue
            if merged and at_s <= merged[-1][1]:
                begin_s, end_s = merged.pop()
                merged.append((begin_s, max(end_s, at_s - by_s)))
            else:
                merged.append((at_s, at_s - by_s))
        return merged

    def _lost_s(self, passed_s: Floats) -> Floats:
        table = self._table
        lost_s = min(table.lost_s, table.lost_every_s)
        periods, into_s = np.divmod(passed_s, table.lost_every_s)
        in_period_s = np.maximum(0.0, into_s - (table.lost_every_s - lost_s))
        return np.asarray(periods * lost_s + in_period_s)

    def shown_s(self, true_s: float) -> float:
        if self.is_steady:
            return true_s * self._rate
        return float(self._shown_s(np.array([true_s]))[0])

    def true_s(self, shown_s: float) -> float:
        """Return when it begins to show a time; infinity if it never does."""
        return float(self.true_times_s(np.array([shown_s]))[0])

    def true_times_s(self, shown_s: Floats) -> Floats:
        """`true_s` of times (n,)."""
        if self.is_steady:
            return np.asarray(shown_s / self._rate)
        # It never runs back: halve until the first time is found. While it stands still
        # rounding alone makes it differ.
        shown_s = shown_s - ROUNDING_S
        low_s = np.zeros_like(shown_s)
        high_s = np.full_like(shown_s, 1.0)
        while ((late := self._shown_s(high_s) < shown_s) & (high_s < FOREVER_S)).any():
            high_s = np.where(late, 2.0 * high_s, high_s)
        for _ in range(HALVINGS):
            middle_s = (low_s + high_s) / 2.0
            before = self._shown_s(middle_s) < shown_s
            low_s = np.where(before, middle_s, low_s)
            high_s = np.where(before, high_s, middle_s)
        return np.where(high_s < FOREVER_S / 2.0, high_s, np.inf)

    def _shown_s(self, true_s: Floats) -> Floats:
        """Return readings at times (n,): first the running time, then by its rate."""
        table, run_s = self._table, np.array(true_s)
        if table.stops_at_s is not None:
            run_s = np.minimum(run_s, table.stops_at_s)
        passed_s = run_s.copy()
        run_s -= self._lost_s(passed_s)
        for begin_s, end_s in self._standstills:
            within_s = np.clip(passed_s, begin_s, end_s)
            # What is lost within a standstill anyway is not lost twice.
            lost_s = self._lost_s(within_s) - self._lost_s(np.array([begin_s]))
            run_s -= within_s - begin_s - lost_s
        ahead_s = np.zeros_like(run_s)
        for at_s, by_s in table.steps:
            if by_s > 0.0:
                ahead_s += np.where(passed_s > at_s, by_s, 0.0)
        drifting_s = np.minimum(run_s, table.drift_s)
        drift_s = drifting_s * (run_s - drifting_s / 2.0)
        shown_s = run_s * self._rate + 1e-6 * table.drift_ppm_per_s * drift_s
        return np.asarray(shown_s + ahead_s)
