"""Names of common points in another order, in which they fit as well.

Points of a symmetric disposition, such as the corners of a rectangle, can be touched in
a wrong order without any residual: the part is then turned, mostly by half a turn.

Strategy: the three points that span the largest triangle are laid onto each three
others with the same sides; where that lays all points onto points, it is an order. The
side lengths leave few such threes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.helmert.transformation import closed_helmert

ALIKE = 2.0  # errors, root mean square: a test hardly sees less
LEAST_ALIKE = 1e-6  # of the points' size, where there are no errors
FAR = 6.0  # tolerances that a point may be off which the triangle lays elsewhere
MOST_POINTS = 60


@dataclass(frozen=True, slots=True, eq=False)
class OtherOrder:
    """Another order of the points.

    Attributes:
        order: Row of the point that takes the place of each, (n,).
        turn_rad: By which that turns the points, from 0 to pi.
    """

    order: Integers
    turn_rad: float


def other_orders(places_mm: Floats, error_mm: float) -> list[OtherOrder]:
    """Find proper motions that lay points onto themselves in another order.

    Args:
        places_mm: Not on one line, (n, 3).
        error_mm: Of a point, root mean square.

    Returns:
        One for each order; those that exchange the fewest points first. None of more
        than `MOST_POINTS`.
    """
    if len(places_mm) > MOST_POINTS:
        return []
    size_mm = float(np.linalg.norm(places_mm - places_mm.mean(axis=0), axis=1).max())
    tolerance_mm = max(ALIKE * error_mm, LEAST_ALIKE * size_mm)
    as_named = np.arange(len(places_mm))
    orders: dict[bytes, OtherOrder] = {}
    for order in _candidates(places_mm, tolerance_mm):
        if np.array_equal(order, as_named) or order.tobytes() in orders:
            continue
        targets_mm = places_mm[order]
        fit = closed_helmert(
            places_mm, targets_mm, np.ones(len(order)), with_scale=False
        )
        off_mm = np.linalg.norm(fit.places_mm(places_mm) - targets_mm, axis=1)
        if np.sqrt(np.mean(off_mm**2)) <= tolerance_mm:
            cosine = 0.5 * (np.trace(fit.rotation) - 1.0)
            turn_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
            orders[order.tobytes()] = OtherOrder(order, turn_rad)
    return sorted(orders.values(), key=lambda o: np.count_nonzero(o.order != as_named))


def _candidates(places_mm: Floats, tolerance_mm: float) -> Iterator[Integers]:
    """Lay the largest triangle onto others like it; yield where that lays all."""
    between_mm = np.linalg.norm(places_mm[:, np.newaxis] - places_mm, axis=2)
    base = _large_triangle(places_mm)
    first, second, third = base
    near_mm = FAR * tolerance_mm
    like_first = np.abs(between_mm - between_mm[first, second]) <= near_mm
    like_third = np.abs(between_mm - between_mm[first, third]) <= near_mm
    like_second = np.abs(between_mm - between_mm[second, third]) <= near_mm
    for a, b in np.argwhere(like_first):
        for c in np.flatnonzero(like_third[a] & like_second[b]):
            if len({int(a), int(b), int(c)}) < len(base):
                continue
            laid = closed_helmert(
                places_mm[list(base)],
                places_mm[[a, b, c]],
                np.ones(len(base)),
                with_scale=False,
            ).places_mm(places_mm)
            off_mm = np.linalg.norm(laid[:, np.newaxis] - places_mm, axis=2)
            order = np.argmin(off_mm, axis=1)
            is_order = len({*order.tolist()}) == len(order)
            if is_order and off_mm.min(axis=1).max() <= near_mm:
                yield order


def _large_triangle(places_mm: Floats) -> tuple[int, int, int]:
    """Return three points: two far from each other, one far off their line."""
    away_mm = np.linalg.norm(places_mm - places_mm.mean(axis=0), axis=1)
    first = int(np.argmax(away_mm))
    from_first_mm = places_mm - places_mm[first]
    second = int(np.argmax(np.linalg.norm(from_first_mm, axis=1)))
    off_line_mm = np.linalg.norm(np.cross(from_first_mm, from_first_mm[second]), axis=1)
    return first, second, int(np.argmax(off_line_mm))
