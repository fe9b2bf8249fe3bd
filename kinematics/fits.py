"""Closed-form fits of measured points: sphere, sphere of known radius, one point.

Spheres: |p - c|^2 = r^2 is linear in c and r^2 - |c|^2; that algebraic solution
starts a few Gauss-Newton steps on the geometric distances |p - c| - r.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LARGEST_NUMBER_OF_STEPS = 50
_STEP_TOLERANCE = 1e-13  # of the size of the point cloud
# Least ratio of singular values of centred points: below, rounding decides the fit.
_FLAT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A fitted sphere; rms is of the geometric distances to it.

    Attributes:
        centre_mm: (3,).
        radius_mm: As fitted or as given.
        rms_mm: Root mean square of |p - c| - r over all points.
    """

    centre_mm: Floats
    radius_mm: float
    rms_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """How points that should coincide lie about their mean.

    Attributes:
        mean_mm: (3,).
        max_deviation_mm: Largest distance from the mean.
        rms_mm: Root mean square of the distances from the mean.
    """

    mean_mm: Floats
    max_deviation_mm: float
    rms_mm: float


def fit_sphere(points_mm: Floats) -> Sphere:
    """Fit centre and radius to points of a surface.

    Args:
        points_mm: At least four, not in one plane, (n_points, 3).

    Raises:
        ValueError: Too few points, or all in one plane.
    """
    points_mm = _checked(points_mm, at_least=4)
    mean_mm = points_mm.mean(axis=0)
    local_mm = points_mm - mean_mm
    extent_mm = _extent_outside_plane(local_mm)
    centre_mm, radius_mm = _algebraic_sphere(local_mm / extent_mm)
    centre_mm, radius_mm = centre_mm * extent_mm, radius_mm * extent_mm
    for _ in range(_LARGEST_NUMBER_OF_STEPS):
        distances_mm, directions = _distances(local_mm, centre_mm)
        design = np.column_stack([-directions, -np.ones(len(local_mm))])
        step = -np.linalg.lstsq(design, distances_mm - radius_mm, rcond=None)[0]
        centre_mm = centre_mm + step[:3]
        radius_mm = radius_mm + float(step[3])
        if np.max(np.abs(step)) < _STEP_TOLERANCE * extent_mm:
            break
    return _sphere(local_mm, mean_mm, centre_mm, radius_mm)


def fit_sphere_of_radius(points_mm: Floats, radius_mm: float) -> Sphere:
    """Fit the centre of a sphere whose radius is known.

    Args:
        points_mm: At least four, not in one plane, (n_points, 3).
        radius_mm: Of the surface that the points lie on, above zero.

    Raises:
        ValueError: Too few points, all in one plane, or no radius.
    """
    if not (np.isfinite(radius_mm) and radius_mm > 0.0):
        raise ValueError(f"radius_mm is {radius_mm}, expected a length above zero")
    points_mm = _checked(points_mm, at_least=4)
    mean_mm = points_mm.mean(axis=0)
    local_mm = points_mm - mean_mm
    extent_mm = _extent_outside_plane(local_mm)
    start_mm, _ = _algebraic_sphere(local_mm / extent_mm)
    centre_mm = start_mm * extent_mm
    for _ in range(_LARGEST_NUMBER_OF_STEPS):
        distances_mm, directions = _distances(local_mm, centre_mm)
        misclosures_mm = distances_mm - radius_mm
        step_mm = -np.linalg.lstsq(-directions, misclosures_mm, rcond=None)[0]
        centre_mm = centre_mm + step_mm
        if np.max(np.abs(step_mm)) < _STEP_TOLERANCE * extent_mm:
            break
    return _sphere(local_mm, mean_mm, centre_mm, radius_mm)


def spread_about_mean(points_mm: Floats) -> Spread:
    """Say how points that should coincide do: (n_points, 3), at least one."""
    points_mm = _checked(points_mm, at_least=1)
    mean_mm = points_mm.mean(axis=0)
    distances_mm = np.linalg.norm(points_mm - mean_mm, axis=1)
    return Spread(mean_mm, float(distances_mm.max()), _rms(distances_mm))


def _checked(points_mm: Floats, at_least: int) -> Floats:
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


def _extent_outside_plane(local_mm: Floats) -> float:
    """Refuse points in one plane; say the size of the cloud otherwise."""
    sizes = np.linalg.svd(local_mm, compute_uv=False)
    if not sizes[2] > _FLAT * sizes[0]:
        raise ValueError(
            f"all {len(local_mm)} points lie in one plane, which fits no single "
            "sphere; measure points at other heights too"
        )
    return float(sizes[0])


def _algebraic_sphere(local: Floats) -> tuple[Floats, float]:
    design = np.column_stack([2.0 * local, np.ones(len(local))])
    squares = np.einsum("ij,ij->i", local, local)
    solution = np.linalg.lstsq(design, squares, rcond=None)[0]
    centre: Floats = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))


def _distances(local_mm: Floats, centre_mm: Floats) -> tuple[Floats, Floats]:
    """Compute the distances from a centre, (n,), and unit vectors, (n, 3)."""
    from_centre_mm = local_mm - centre_mm
    distances_mm: Floats = np.linalg.norm(from_centre_mm, axis=1)
    if not np.all(distances_mm > 0.0):
        raise ValueError("a point lies in the centre of the sphere; leave it out")
    return distances_mm, from_centre_mm / distances_mm[:, np.newaxis]


def _sphere(
    local_mm: Floats, mean_mm: Floats, centre_mm: Floats, radius_mm: float
) -> Sphere:
    distances_mm = np.linalg.norm(local_mm - centre_mm, axis=1)
    return Sphere(mean_mm + centre_mm, radius_mm, _rms(distances_mm - radius_mm))


def _rms(lengths_mm: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(lengths_mm))))
