"""Control charts that judge from the third check on, and know how often they err.

Each value is compared with those before it: their mean and standard deviation make of
it a t-distributed number, and that a normal one (Quesenberry's Q, 1991). While nothing
changes, and the values are normal, these are independent standard normal numbers, so
the rules' false alarms are known however short the history is. Values that raised an
alarm do not count for later ones; after `BASE` of them the base is settled, so that a
slow drift is not learned. Figures that cannot be negative are charted by their
square root, which makes them nearly normal, and judged above alone: an arm that repeats
better is no alarm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from traverse.lab.daily_check.false_alarm_rates import (
    BASE,
    EWMA_LIMIT,
    INDIVIDUAL,
    RANGE,
    WEIGHT,
    Side,
    individual_rate,
    range_rate,
    settled_ewma_rate,
)

FEWEST = 2  # values that make a first comparison


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of the chart.

    Attributes:
        name: In words, as people and JSON get it.
        rate: False alarms a check.
    """

    name: str
    rate: float


@dataclass(frozen=True, slots=True)
class ChartPoint:
    """One value on its chart; in units of its own standard deviation where it says so.

    Attributes:
        value: As measured.
        q: How unusual beside those before it; None where there were too few.
        moving_range: |q - q before|; None without either.
        ewma: Exponentially weighted mean of q so far.
        centre, low, high: Of the individuals chart, in the value's unit; None without
            q, and low where only values above are judged.
        alarms: Names of the rules that it breaks.
    """

    value: float
    q: float | None
    moving_range: float | None
    ewma: float
    centre: float | None
    low: float | None
    high: float | None
    alarms: tuple[str, ...]


def rules(side: Side) -> tuple[Rule, Rule, Rule]:
    """Say the rules, with their rates."""
    beyond = "beyond" if side == "both" else "above"
    return (
        Rule(f"one check {beyond} {INDIVIDUAL:g} sigma", individual_rate(side)),
        Rule(f"moving range above {RANGE:g} sigma", range_rate(side)),
        Rule(
            f"EWMA (weight {WEIGHT:g}) {beyond} {EWMA_LIMIT:.2f} sigma",
            settled_ewma_rate(side),
        ),
    )


def charted(values: Sequence[float], *, positive: bool) -> list[ChartPoint]:
    """Judge values in the order in which they were measured.

    Args:
        values: Of one figure.
        positive: They cannot be negative.

    Raises:
        ValueError: A positive figure is not, or a value is no number.
    """
    given = np.array(values, dtype=np.float64)
    if not np.isfinite(given).all() or (positive and (given <= 0.0).any()):
        raise ValueError("a figure is not finite, or not above zero where it must be")
    side: Side = "above" if positive else "both"
    scale = np.sqrt(given) if positive else given
    base: list[float] = []
    found: list[ChartPoint] = []
    ewma, before = 0.0, None
    for value, x in zip(given.tolist(), scale.tolist(), strict=True):
        q: float | None = None
        limits: tuple[float | None, float | None, float | None] = (None, None, None)
        if len(base) >= FEWEST:
            q, limits = _unusual(x, base, positive=positive)
            ewma = (1.0 - WEIGHT) * ewma + WEIGHT * q
        step = None if q is None or before is None else q - before
        alarms = _alarms(side, q, step, ewma)
        found.append(
            ChartPoint(
                value, q, None if step is None else abs(step), ewma, *limits, alarms
            )
        )
        before = q
        if not alarms and len(base) < BASE:
            base.append(x)
    return found


def _alarms(
    side: Side, q: float | None, step: float | None, ewma: float
) -> tuple[str, ...]:
    def beyond(amount: float | None, limit: float) -> bool:
        if amount is None:
            return False
        return (amount if side == "above" else abs(amount)) > limit

    one, ranged, weighted = rules(side)
    told = (
        (one.name, beyond(q, INDIVIDUAL)),
        (ranged.name, beyond(step, RANGE)),
        (weighted.name, beyond(None if q is None else ewma, EWMA_LIMIT)),
    )
    return tuple(name for name, is_broken in told if is_broken)


def _unusual(
    x: float, base: Sequence[float], *, positive: bool
) -> tuple[float, tuple[float, float | None, float]]:
    """How unusual a value is; centre and limits for such values, in their unit."""
    n = len(base)
    mean = float(np.mean(base))
    # Equal values are possible where figures are rounded; then any other is unusual.
    std = max(float(np.std(base, ddof=1)), 1e-9) * float(np.sqrt(1.0 + 1.0 / n))
    t = (x - mean) / std
    q = float(np.copysign(-special.ndtri(special.stdtr(n - 1, -abs(t))), t))
    q = float(np.clip(q, -30.0, 30.0))
    wide = std * float(-special.stdtrit(n - 1, special.ndtr(-INDIVIDUAL)))
    if positive:
        return q, (mean**2, None, (mean + wide) ** 2)
    return q, (mean, mean - wide, mean + wide)
