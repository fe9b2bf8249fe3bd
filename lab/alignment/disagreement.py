"""Why two lists of common points have different shapes: a unit, or exchanged names.

Neither is small: where the cause is one of these, the residuals fail every test, and
what the tests say of single points leads astray.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import closed_helmert
from traverse.lab.alignment.result import WORDS, AlignmentWarning

_UNITS = {"metres": 1000.0, "inches": 25.4, "centimetres": 10.0, "feet": 304.8}
_SAME_UNIT = 0.02  # of the ratio
_OTHER_SIZE = 2.0
_EXPLAINED = 0.01  # of the sum of squares remains
_MOST_POINTS = 60


def disagreements(
    names: Sequence[str], from_mm: Floats, to_mm: Floats
) -> Iterator[AlignmentWarning]:
    """Name the causes that explain the residuals, if any.

    Args:
        names: Of the common points, (n,).
        from_mm: As measured, (n, 3).
        to_mm: Nominal, (n, 3).
    """
    weights = np.ones(len(names))
    scale = closed_helmert(from_mm, to_mm, weights, with_scale=True).scale
    units = [
        (unit, side)
        for unit, length_mm in _UNITS.items()
        for side, ratio in (("measured", scale), ("nominal", 1.0 / scale))
        if abs(ratio / length_mm - 1.0) < _SAME_UNIT
    ]
    if units or not 1.0 / _OTHER_SIZE < scale < _OTHER_SIZE:
        text = WORDS.other_size(1.0 / scale, units[0] if units else None)
        yield AlignmentWarning("other_size", text)
        return
    pair = _exchanged(from_mm, to_mm)
    if pair is not None:
        text = WORDS.exchanged_names(*(names[row] for row in pair))
        yield AlignmentWarning("exchanged_names", text)


def _exchanged(from_mm: Floats, to_mm: Floats) -> tuple[int, int] | None:
    """Find the two points whose exchange explains the residuals."""
    n = len(from_mm)
    if n > _MOST_POINTS:
        return None
    before_mm2 = _squares_mm2(from_mm, to_mm)
    exchanges = list(combinations(range(n), 2))
    after_mm2 = []
    for first, second in exchanges:
        order = np.arange(n)
        order[[first, second]] = second, first
        after_mm2.append(_squares_mm2(from_mm[order], to_mm))
    best = int(np.argmin(after_mm2))
    others = np.delete(after_mm2, best)
    explains = after_mm2[best] < _EXPLAINED * min(before_mm2, *others)
    return exchanges[best] if explains else None


def _squares_mm2(from_mm: Floats, to_mm: Floats) -> float:
    fit = closed_helmert(from_mm, to_mm, np.ones(len(to_mm)), with_scale=False)
    return float(np.sum((to_mm - fit.places_mm(from_mm)) ** 2))
