"""Points that should coincide: their spread, and the smallest sphere around them.

The smallest sphere is the circumscribed one of 1 to 4 of the points, its supports, in
whose convex hull its centre lies. From the supports so far and the farthest point
outside, at most five, the smallest sphere of these is found by trying all their
subsets; its radius grows in every round, so there is an end. Fewer supports are
preferred where several subsets give the same sphere.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.shapes import checked_points

_ROUNDING = 1e-12  # of the extent of the points
_DEPENDENT = 1e-10
_OUTSIDE = 1e-9  # by that much a centre may lie outside of the hull, for rounding


@dataclass(frozen=True, slots=True, eq=False)
class EnclosingSphere:
    """The smallest sphere around points.

    Attributes:
        centre_mm: (3,).
        radius_mm: 0 of a single place.
        supports: Indices of the 1 to 4 points that hold it, rising.
    """

    centre_mm: Floats
    radius_mm: float
    supports: tuple[int, ...]


def enclosing_sphere(points_mm: Floats) -> EnclosingSphere:
    """Find the smallest sphere around points, (n_points, 3), at least one.

    Raises:
        ValueError: no points, or values that are not finite.
    """
    points_mm = checked_points(points_mm, at_least=1)
    mean_mm = points_mm.mean(axis=0)
    local = points_mm - mean_mm
    extent_mm = float(np.max(np.linalg.norm(local, axis=1)))
    if extent_mm == 0.0:
        return EnclosingSphere(points_mm[0].copy(), 0.0, (0,))
    local = local / extent_mm
    supports: tuple[int, ...] = (int(np.argmax(np.linalg.norm(local, axis=1))),)
    centre, radius = local[supports[0]], 0.0
    while True:
        away = np.linalg.norm(local - centre, axis=1)
        farthest = int(np.argmax(away))
        if away[farthest] <= radius + _ROUNDING:
            break
        candidates = (*supports, farthest)
        smallest = _smallest(local, candidates)
        if smallest is None or smallest[1] <= radius:  # rounding: none is larger
            break
        centre, radius, supports = smallest
    return EnclosingSphere(
        mean_mm + extent_mm * centre, extent_mm * radius, tuple(sorted(supports))
    )


def _smallest(
    local: Floats, candidates: tuple[int, ...]
) -> tuple[Floats, float, tuple[int, ...]] | None:
    """Find the smallest sphere around a few points by trying all their subsets."""
    best: tuple[Floats, float, tuple[int, ...]] | None = None
    chosen = local[list(candidates)]
    for size in range(1, min(4, len(candidates)) + 1):
        for subset in combinations(candidates, size):
            sphere = _circumscribed(local[list(subset)])
            if sphere is None:
                continue
            centre, radius = sphere
            away = np.linalg.norm(chosen - centre, axis=1)
            encloses = np.max(away) <= radius + _ROUNDING
            if encloses and (best is None or radius < best[1] - _ROUNDING):
                best = centre, radius, subset
    return best


def _circumscribed(points: Floats) -> tuple[Floats, float] | None:
    """Find centre and radius of the sphere through 1 to 4 points, centre among them.

    Nothing where points coincide, lie on a line (three) or in a plane (four), or where
    the centre is not in their convex hull.
    """
    edges = points[1:] - points[0]
    if len(edges) == 0:
        return points[0], 0.0
    sizes = np.linalg.svd(edges, compute_uv=False)
    if not sizes[-1] > _DEPENDENT * sizes[0]:
        return None
    # c - p_0 = E' w, with 2 E E' w = the squares of the edges.
    gram = edges @ edges.T
    weights = np.linalg.solve(2.0 * gram, np.diag(gram))
    if min(float(weights.min()), 1.0 - float(weights.sum())) < -_OUTSIDE:
        return None  # a smaller sphere encloses them, or a part of them
    from_first = weights @ edges
    return points[0] + from_first, float(np.linalg.norm(from_first))


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Spread of points about their mean.

    Attributes:
        mean_mm: (3,).
        deviations_mm: distances from the mean, (n_points,).
    """

    mean_mm: Floats
    deviations_mm: Floats

    @property
    def max_deviation_mm(self) -> float:
        return float(self.deviations_mm.max())

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt(np.mean(np.square(self.deviations_mm))))

    @property
    def two_s_mm(self) -> float:
        """2 s of two or more points, s = sqrt(sum d^2 / (n - 1))."""
        squares_mm2 = float(self.deviations_mm @ self.deviations_mm)
        return 2.0 * float(np.sqrt(squares_mm2 / (len(self.deviations_mm) - 1)))


def spread_about_mean(points_mm: Floats) -> Spread:
    """Compute the spread of (n_points, 3), at least one."""
    points_mm = checked_points(points_mm, at_least=1)
    mean_mm = points_mm.mean(axis=0)
    return Spread(mean_mm, np.linalg.norm(points_mm - mean_mm, axis=1))
