"""Control charts that judge from the third check on, and know how often they err.

Each value is compared with those before it: their mean and standard deviation make of
it a t-distributed number, and that a normal one (Quesenberry's Q, 1991). While nothing
changes, and the values are normal, these are independent standard normal numbers, so
the rules' false alarms are known however short the history is. Values that raised an
alarm do not count for later ones; after `BASE` of them the base is settled, so that a
slow drift is not learned. Figures that cannot be negative are charted by their
square root, which makes them nearly normal, and judged above alone: an arm that repeats
better is no alarm.

How often the rules of a control chart alarm while nothing has changed.

Of values that are independent and normal with mean 0 and standard deviation 1, which is
what `control_chart` makes of the figures. Rates are per check; the exponentially
weighted mean's is the inverse of its average run length, by a Markov chain (Brook and
Evans, 1972).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from scipy import special

from traverse.arrays import Floats

Side = Literal["both", "above"]

INDIVIDUAL = 3.5
RANGE = 4.9
WEIGHT = 0.2
EWMA = 3.6  # in standard deviations of the weighted mean
EWMA_LIMIT = EWMA * float(np.sqrt(WEIGHT / (2.0 - WEIGHT)))
STATES = 401
BASE = 50  # values that the mean and the standard deviation are of, in the long run
NODES = 15
DEEP = 6.0  # the weighted mean is nearly never so many standard deviations below


def individual_rate(side: Side) -> float:
    """Of one value beyond its limit."""
    return float(special.ndtr(-INDIVIDUAL)) * (2.0 if side == "both" else 1.0)


def range_rate(side: Side) -> float:
    """Of two successive values too far apart."""
    return float(special.ndtr(-RANGE / np.sqrt(2.0))) * (2.0 if side == "both" else 1.0)


@cache
def settled_ewma_rate(side: Side) -> float:
    """Of the exponentially weighted mean, beside a base that is settled.

    The base's mean is off by chance, by one in `sqrt(BASE)` standard deviations, and
    stays so: the rate is the mean over what it may be off by. It is more than while
    the base still grows.
    """
    off, weights = np.polynomial.hermite_e.hermegauss(NODES)
    rates = [ewma_rate(side, float(shift)) for shift in off / np.sqrt(BASE)]
    return float(np.average(rates, weights=weights))


@cache
def ewma_rate(side: Side, shift: float = 0.0, limit: float = EWMA_LIMIT) -> float:
    """Of the exponentially weighted mean beyond its limit.

    The values' mean may be shifted; the inverse says how long that is unseen.
    """
    low = -limit if side == "both" else -DEEP / EWMA * EWMA_LIMIT
    edges = np.linspace(low, limit, STATES + 1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    reached = (edges[np.newaxis] - (1.0 - WEIGHT) * middles[:, np.newaxis]) / WEIGHT
    below = special.ndtr(reached - shift)
    steps = np.diff(below, axis=1)
    if side == "above":
        steps[:, 0] += below[:, 0]
    lengths = np.linalg.solve(np.eye(STATES) - steps, np.ones(STATES))
    return 1.0 / float(np.interp(0.0, middles, lengths))


FEWEST = 2  # values that make a first comparison
FEWEST_OF_DRIFT = 5
DRIFT_LEVEL = 1e-4  # probability by chance below which a slope is a drift


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of the chart in words, its limit, and its false alarms a check."""

    name: str
    limit: float
    rate: float


@dataclass(frozen=True, slots=True)
class ChartPoint:
    """One value on its chart; in units of its own standard deviation where it says so.

    Attributes:
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
    """Return the rules, with their rates."""
    beyond = "beyond" if side == "both" else "above"
    return (
        Rule(
            f"one check {beyond} {INDIVIDUAL:g} sigma",
            INDIVIDUAL,
            individual_rate(side),
        ),
        Rule(f"moving range above {RANGE:g} sigma", RANGE, range_rate(side)),
        Rule(
            f"EWMA (weight {WEIGHT:g}) {beyond} {EWMA_LIMIT:.2f} sigma",
            EWMA_LIMIT,
            settled_ewma_rate(side),
        ),
    )


def charted(
    values: Sequence[float], *, positive: bool, most: float = np.inf
) -> list[ChartPoint]:
    """Judge values of one figure in the order in which they were measured.

    Values beyond the most are judged, but are no base for later ones.

    Raises:
        ValueError: A positive figure is not, or a value is no number.
    """
    finite_values = np.array(values, dtype=np.float64)
    if not np.isfinite(finite_values).all() or (
        positive and (finite_values <= 0.0).any()
    ):
        raise ValueError("a figure is not finite, or not above zero where it must be")
    side: Side = "above" if positive else "both"
    scale = np.sqrt(finite_values) if positive else finite_values
    base: list[float] = []
    points: list[ChartPoint] = []
    ewma, before = 0.0, None
    for value, x in zip(finite_values.tolist(), scale.tolist(), strict=True):
        q: float | None = None
        limits: tuple[float | None, float | None, float | None] = (None, None, None)
        if len(base) >= FEWEST:
            q, limits = _unusual(x, base, positive=positive)
            ewma = (1.0 - WEIGHT) * ewma + WEIGHT * q
        step = None if q is None or before is None else q - before
        alarms = _alarms(side, q, step, ewma)
        points.append(
            ChartPoint(
                value, q, None if step is None else abs(step), ewma, *limits, alarms
            )
        )
        before = q
        if not alarms and abs(value) <= most and len(base) < BASE:
            base.append(x)
    return points


def drift_per_check(figures: Sequence[float], *, positive: bool) -> float | None:
    """Return how much values change from one to the next; None: chance does as much.

    By the t-test of the slope of a straight line. Strategy: a drift that began with the
    base is part of its mean and of its spread, so that no other rule sees it. Of
    positive figures only growth counts.
    """
    values: Floats = np.asarray(figures, dtype=np.float64)
    n = len(values)
    if n < FEWEST_OF_DRIFT:
        return None
    places, deviations = np.arange(n) - 0.5 * (n - 1), values - np.mean(values)
    slope = float(places @ deviations / (places @ places))
    left = deviations - slope * places
    error = max(float(np.sqrt(left @ left / (n - 2) / (places @ places))), 1e-12)
    chance = float(special.stdtr(n - 2, -abs(slope) / error)) * (1 if positive else 2)
    if chance > DRIFT_LEVEL or (positive and slope < 0.0):
        return None
    return slope


def _alarms(
    side: Side, q: float | None, step: float | None, ewma: float
) -> tuple[str, ...]:
    amounts = (q, step, None if q is None else ewma)
    return tuple(
        rule.name
        for rule, amount in zip(rules(side), amounts, strict=True)
        if amount is not None
        and (amount if side == "above" else abs(amount)) > rule.limit
    )


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
