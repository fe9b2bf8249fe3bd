"""Spheres: |p - c| - r, with the radius unknown or known.

|p - c|^2 = r^2 is linear in c and r^2 - |c|^2; that algebraic solution starts the
Gauss-Newton steps on the distances.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import (
    Precision,
    adjusted,
    cloud_of,
)

_State = tuple[Floats, float]


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A fitted sphere; rms is of the geometric distances to it.

    Attributes:
        centre_mm: (3,).
        rms_mm: Root mean square of |p - c| - r over all points.
        precision: Of centre and radius, or of the centre alone.
    """

    centre_mm: Floats
    radius_mm: float
    rms_mm: float
    precision: Precision


def fit_sphere(points_mm: Floats) -> Sphere:
    """Fit centre and radius to points of a surface.

    Args:
        points_mm: At least four, not in one plane, (n_points, 3).

    Raises:
        ValueError: Too few points, or all in one plane.
    """
    return _fit(points_mm, None)


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
    found = _fit(points_mm, radius_mm)
    return Sphere(found.centre_mm, radius_mm, found.rms_mm, found.precision)


def _fit(points_mm: Floats, radius_mm: float | None) -> Sphere:
    cloud = cloud_of(points_mm, at_least=4)
    cloud.refuse_degenerate("sphere", flat=True)
    points = cloud.points

    def linearised(state: _State) -> tuple[Floats, Floats]:
        centre, radius = state
        from_centre = points - centre
        lengths = np.linalg.norm(from_centre, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies in the centre of the sphere; leave it out")
        design = -(from_centre / lengths[:, np.newaxis])
        if radius_mm is None:
            design = np.column_stack([design, -np.ones(len(points))])
        return lengths - radius, design

    def moved(state: _State, step: Floats) -> _State:
        return state[0] + step[:3], state[1] + float(step[3:].sum())

    centre, radius = _algebraic(points)
    if radius_mm is not None:
        radius = radius_mm / cloud.extent_mm
    state, distances, design = adjusted((centre, radius), linearised, moved, "sphere")
    return Sphere(
        cloud.mean_mm + cloud.extent_mm * state[0],
        cloud.extent_mm * state[1],
        *cloud.quality("sphere", distances, design, np.eye(design.shape[1])),
    )


def _algebraic(local: Floats) -> _State:
    design = np.column_stack([2.0 * local, np.ones(len(local))])
    squares = np.einsum("ij,ij->i", local, local)
    solution = np.linalg.lstsq(design, squares, rcond=None)[0]
    centre: Floats = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))
