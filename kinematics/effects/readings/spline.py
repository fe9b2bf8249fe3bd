"""Natural cubic splines through values at knots, held beyond the outer knots.

Between two knots, a and b the distances to them over that of the knots h, and m the
second derivatives at the knots, which vanish at the outer ones:

    s = b y_i + a y_(i+1) + h^2/6 ((b^3 - b) m_i + (a^3 - a) m_(i+1))

m is linear in the values, so s is a sum of value times a spline that is 1 at its knot.
"""

from functools import lru_cache

import numpy as np

from traverse.arrays import Floats


def spline_amounts(knots: tuple[float, ...], readings: Floats) -> Floats:
    """Compute the unit splines.

    Args:
        knots: increasing, at least 2.
        readings: (n,); beyond the outer knots the value there is held.

    Returns:
        (n_knots, n).
    """
    places, steps, curvatures = _tables(knots)
    held = np.minimum(np.maximum(readings, places[0]), places[-1])
    # The outer knots are left out: what is held there belongs to its neighbour.
    left = np.searchsorted(places[1:-1], held, side="right")
    step = steps[left]
    a = (held - places[left]) / step
    b = (places[left + 1] - held) / step
    values = np.eye(len(places))
    chord = b * values[:, left] + a * values[:, left + 1]
    bow = (b * b * b - b) * curvatures[:, left]
    bow += (a * a * a - a) * curvatures[:, left + 1]
    amounts: Floats = chord + (step * step / 6.0) * bow
    return amounts


def spline_numbers(
    knots: tuple[float, ...], values: tuple[float, ...]
) -> tuple[float, ...]:
    """Knots, steps (and a 0), values and m, as the kernel in C takes a spline."""
    places, steps, curvatures = _tables(knots)
    bows = np.array(values) @ curvatures
    rows = (places, np.append(steps, 0.0), values, bows)
    return tuple(np.concatenate(rows).tolist())


def straight_on(
    knots: tuple[float, ...], values: tuple[float, ...], readings: Floats
) -> Floats:
    """Return the difference between straight continuations and held values.

    The slope of a natural spline at its first knot is (y_1 - y_0)/h - h m_1/6, at its
    last (y_n - y_(n-1))/h + h m_(n-1)/6.

    Args:
        knots: increasing, at least 2.
        values: at the knots.
        readings: (n,).

    Returns:
        In the unit of the values, (n,); 0 between the knots.
    """
    places, steps, curvatures = _tables(knots)
    slopes, bows = np.diff(values) / steps, np.array(values) @ curvatures
    first = slopes[0] - steps[0] * bows[1] / 6.0
    last = slopes[-1] + steps[-1] * bows[-2] / 6.0
    away: Floats = first * np.minimum(readings - places[0], 0.0)
    away += last * np.maximum(readings - places[-1], 0.0)
    return away


# The knots of an effect never change, and every block uses them.
@lru_cache(maxsize=64)
def _tables(knots: tuple[float, ...]) -> tuple[Floats, Floats, Floats]:
    """Knots, the steps between them, and `_curvatures`."""
    places = np.array(knots)
    steps = np.diff(places)
    return places, steps, _curvatures(steps)


def _curvatures(steps: Floats) -> Floats:
    """Second derivatives at the knots of every unit spline, (n_knots, n_knots)."""
    n_knots = len(steps) + 1
    curvatures = np.zeros((n_knots, n_knots))
    if n_knots == 2:
        return curvatures
    inner = np.arange(n_knots - 2)
    slopes = (np.eye(n_knots)[1:] - np.eye(n_knots)[:-1]) / steps[:, np.newaxis]
    system = np.zeros((n_knots - 2, n_knots))
    system[inner, inner] = steps[:-1] / 6.0
    system[inner, inner + 1] = (steps[:-1] + steps[1:]) / 3.0
    system[inner, inner + 2] = steps[1:] / 6.0
    curvatures[:, 1:-1] = np.linalg.solve(system[:, 1:-1], np.diff(slopes, axis=0)).T
    return curvatures
