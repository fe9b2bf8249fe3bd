"""A cloud of points before it is fitted: checked, about its mean, in its own size."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats

# Least ratio of singular values of centred points: below, rounding decides the fit.
FLAT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points in units of their own extent, about their mean.

    Attributes:
        points: (n_points, 3), without unit.
        mean_mm: (3,).
        extent_mm: The unit.
        axes: Principal directions as rows, the longest first, (3, 3).
        sizes: Singular values along them, of the first 1 at most, (3,).
    """

    points: Floats
    mean_mm: Floats
    extent_mm: float
    axes: Floats
    sizes: Floats

    def refuse_flat(self, shape: str) -> None:
        """Refuse points in one plane.

        Raises:
            ValueError: They are, and fit no single shape.
        """
        if not self.sizes[2] > FLAT * self.sizes[0]:
            raise ValueError(
                f"all {len(self.points)} points lie in one plane, which fits no single "
                f"{shape}; measure points at other heights too"
            )

    def refuse_straight(self, shape: str) -> None:
        """Refuse points on one line.

        Raises:
            ValueError: They are, and fit no single shape.
        """
        if not self.sizes[1] > FLAT * self.sizes[0]:
            raise ValueError(
                f"all {len(self.points)} points lie on one line, which fits no single "
                f"{shape}; measure points beside it too"
            )


def checked_points(points_mm: Floats, at_least: int) -> Floats:
    """Return points (n_points, 3) as floats.

    Raises:
        ValueError: Another shape, values that are not finite, too few points.
    """
    points_mm = np.asarray(points_mm, dtype=np.float64)
    if points_mm.ndim != 2 or points_mm.shape[1] != 3:
        raise ValueError(f"points have shape {points_mm.shape}, expected (n_points, 3)")
    if not np.all(np.isfinite(points_mm)):
        raise ValueError("points hold values that are not finite; leave those out")
    if len(points_mm) < at_least:
        raise ValueError(
            f"{len(points_mm)} points given, at least {at_least} are needed; "
            "measure more"
        )
    return points_mm


def cloud_of(points_mm: Floats, at_least: int) -> Cloud:
    """Check points (n_points, 3) and bring them into their own size.

    Raises:
        ValueError: As `checked_points` says; or one and the same place again and again.
    """
    points_mm = checked_points(points_mm, at_least)
    mean_mm = points_mm.mean(axis=0)
    local_mm = points_mm - mean_mm
    _, sizes_mm, axes = np.linalg.svd(local_mm, full_matrices=len(points_mm) < 3)
    sizes_mm = np.append(sizes_mm, np.zeros(3 - len(sizes_mm)))
    extent_mm = float(sizes_mm[0])
    if not extent_mm > FLAT * FLAT * (1.0 + float(np.max(np.abs(mean_mm)))):
        if at_least > 3:  # a plane is what the fits of spheres speak of
            raise ValueError(
                f"all {len(points_mm)} points lie in one plane, even in one place; "
                "measure points elsewhere too"
            )
        raise ValueError(
            f"all {len(points_mm)} points lie in one place; measure points elsewhere "
            "too"
        )
    return Cloud(local_mm / extent_mm, mean_mm, extent_mm, axes, sizes_mm / extent_mm)


def frames_across(directions: Floats) -> Floats:
    """Find two unit vectors across each of many, (n, 3), as columns: (n, 3, 2)."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    along = np.einsum("ni,ni->n", least, directions)
    first = least - along[:, np.newaxis] * directions
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    x, y, z = directions.T
    u, v, w = first.T
    second = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
    return np.stack([first, second], axis=2)
