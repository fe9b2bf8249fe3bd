"""A circle in space: the distance of a point from the curve itself.

With h the height of a point over the circle's plane and q its distance from the
circle's axis, the square of its distance from the curve is (q - r)^2 + h^2: plane and
circle are fitted together. (Some programs fit a plane first and a circle in it then.)
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import (
    Precision,
    adjusted,
    cloud_of,
    turned_positive,
)
from traverse.kinematics.model.geometry import across


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """A fitted circle.

    Attributes:
        centre_mm: (3,).
        normal: Unit vector, its largest component positive, (3,).
        rms_mm: Root mean square of the distances.
        precision: Of centre (mm), normal, radius (mm): (7, 7).
    """

    centre_mm: Floats
    normal: Floats
    radius_mm: float
    rms_mm: float
    precision: Precision


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    centre: Floats
    normal: Floats
    radius: float


def fit_circle(points_mm: Floats) -> Circle:
    """Fit a circle to at least three points, (n_points, 3).

    Raises:
        ValueError: Too few points, on one line, or nothing like a circle.
    """
    cloud = cloud_of(points_mm, at_least=3)
    cloud.refuse_degenerate("circle", flat=False)
    points, n_points = cloud.points, len(cloud.points)

    def linearised(state: _State) -> tuple[Floats, Floats]:
        from_centre = points - state.centre
        height = from_centre @ state.normal
        flat = from_centre - height[:, np.newaxis] * state.normal
        lengths = np.linalg.norm(flat, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies on the axis of the circle; leave it out")
        outwards = flat / lengths[:, np.newaxis]
        first, second = across(state.normal)
        tilts = np.column_stack([first, second])
        in_plane = np.column_stack(
            [
                -outwards,
                -height[:, np.newaxis] * (outwards @ tilts),
                -np.ones(n_points),
            ]
        )
        out_of_plane = np.column_stack(
            [
                np.tile(-state.normal, (n_points, 1)),
                from_centre @ tilts,
                np.zeros(n_points),
            ]
        )
        return (
            np.concatenate([lengths - state.radius, height]),
            np.concatenate([in_plane, out_of_plane]),
        )

    state = adjusted(_start(points, cloud.axes), linearised, _moved, "circle")
    distances, design = linearised(state)
    normal = turned_positive(state.normal)
    known = np.zeros((7, 6))
    known[:3, :3], known[6, 5] = np.eye(3), 1.0
    # Of the state's normal: turned round, its changes are too.
    turned = np.sign(normal @ state.normal) / cloud.extent_mm
    known[3:6, 3:5] = turned * np.column_stack(across(state.normal))
    squares_mm2 = cloud.extent_mm**2 * float(distances @ distances)
    return Circle(
        cloud.mean_mm + cloud.extent_mm * state.centre,
        normal,
        cloud.extent_mm * state.radius,
        *cloud.quality("circle", design, known, squares_mm2),
    )


def _start(points: Floats, axes: Floats) -> _State:
    """Fit a plane, and in it |p - c|^2 = r^2, which is linear in c and r^2 - |c|^2."""
    flat = points @ axes[:2].T
    design = np.column_stack([2.0 * flat, np.ones(len(points))])
    squares = np.einsum("ij,ij->i", flat, flat)
    solution = np.linalg.lstsq(design, squares, rcond=None)[0]
    radius = float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))
    return _State(solution[:2] @ axes[:2], axes[2], radius)


def _moved(state: _State, step: Floats) -> _State:
    first, second = across(state.normal)
    normal = state.normal + step[3] * first + step[4] * second
    return _State(
        state.centre + step[:3],
        normal / np.linalg.norm(normal),
        state.radius + float(step[5]),
    )
