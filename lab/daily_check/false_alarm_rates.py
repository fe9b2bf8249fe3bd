"""How often the rules of a control chart alarm while nothing has changed.

Of values that are independent and normal with mean 0 and standard deviation 1, which is
what `control_chart` makes of the figures. Rates are per check; the exponentially
weighted mean's is the inverse of its average run length, by a Markov chain (Brook and
Evans, 1972).
"""

from functools import cache
from typing import Literal

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

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

    Args:
        side: Whether its lower limit counts, too.
        shift: Of the values' mean; the inverse then says how long a shift is unseen.
        limit: Of the weighted mean.
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
