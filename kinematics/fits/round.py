"""Circles and cylinders, by orthogonal distances.

A circle in space: with h the height of a point over the circle's plane and q its
distance from the circle's axis, the square of its distance from the curve is
(q - r)^2 + h^2: plane and circle are fitted together. (Some programs fit a plane first
and a circle in it then.)

A cylinder: the distance from the axis less the radius. The sum of squares has several
valleys. For a given direction of the axis the points, projected along it, lie on a
circle, whose algebraic fit is closed: directions over a half sphere and the principal
ones of the cloud are tried so, the best few are starts of Gauss-Newton steps, and the
lowest end counts.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import (
    FLAT,
    Cloud,
    Precision,
    adjusted,
    cloud_of,
    frames_across,
    turned_positive,
)
from traverse.kinematics.model.geometry import across


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """A circle with its centre and normal, or a cylinder."""

    point: Floats
    axis: Floats
    radius: float


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


def fit_circle(points_mm: Floats) -> Circle:
    """Fit a circle to at least three points, (n_points, 3).

    Raises:
        ValueError: Too few points, on one line, or nothing like a circle.
    """
    cloud = cloud_of(points_mm, at_least=3)
    cloud.refuse_degenerate("circle", flat=False)
    points, n_points = cloud.points, len(cloud.points)

    def linearised(state: _State) -> tuple[Floats, Floats]:
        from_centre = points - state.point
        height = from_centre @ state.axis
        flat = from_centre - height[:, np.newaxis] * state.axis
        lengths = np.linalg.norm(flat, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies on the axis of the circle; leave it out")
        outwards = flat / lengths[:, np.newaxis]
        first, second = across(state.axis)
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
                np.tile(-state.axis, (n_points, 1)),
                from_centre @ tilts,
                np.zeros(n_points),
            ]
        )
        return (
            np.concatenate([lengths - state.radius, height]),
            np.concatenate([in_plane, out_of_plane]),
        )

    state, distances, design = adjusted(
        _circle_start(points, cloud.axes), linearised, _circle_moved, "circle"
    )
    normal = turned_positive(state.axis)
    known = np.zeros((7, 6))
    known[:3, :3], known[6, 5] = np.eye(3), 1.0
    # Of the state's normal: turned round, its changes are too.
    turned = np.sign(normal @ state.axis) / cloud.extent_mm
    known[3:6, 3:5] = turned * np.column_stack(across(state.axis))
    return Circle(
        cloud.mean_mm + cloud.extent_mm * state.point,
        normal,
        cloud.extent_mm * state.radius,
        *cloud.quality("circle", distances, design, known),
    )


def _circle_start(points: Floats, axes: Floats) -> _State:
    """Fit a plane, and in it |p - c|^2 = r^2, which is linear in c and r^2 - |c|^2."""
    flat = points @ axes[:2].T
    design = np.column_stack([2.0 * flat, np.ones(len(points))])
    squares = np.einsum("ij,ij->i", flat, flat)
    solution = np.linalg.lstsq(design, squares, rcond=None)[0]
    radius = float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))
    return _State(solution[:2] @ axes[:2], axes[2], radius)


def _circle_moved(state: _State, step: Floats) -> _State:
    first, second = across(state.axis)
    normal = state.axis + step[3] * first + step[4] * second
    return _State(
        state.point + step[:3],
        normal / np.linalg.norm(normal),
        state.radius + float(step[5]),
    )


_N_DIRECTIONS = 400
_N_STARTS = 6
_LONGEST_RADIUS = 1e4  # of the extent of the points: flatter ones are a plane


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A fitted cylinder.

    Attributes:
        point_mm: Of the axis, the one nearest to the mean of the points, (3,).
        axis: Unit vector, its largest component positive, (3,).
        rms_mm: Root mean square of the distances.
        precision: Of the point (mm), which moves across the axis only, the axis, the
            radius (mm): (7, 7).
    """

    point_mm: Floats
    axis: Floats
    radius_mm: float
    rms_mm: float
    precision: Precision


def fit_cylinder(points_mm: Floats) -> Cylinder:
    """Fit a cylinder to at least five points, (n_points, 3).

    Raises:
        ValueError: Too few points, in one plane, or nothing like a cylinder.
    """
    cloud = cloud_of(points_mm, at_least=5)
    cloud.refuse_degenerate("cylinder", flat=True)
    points = cloud.points

    def linearised(state: _State) -> tuple[Floats, Floats]:
        from_point = points - state.point
        along = from_point @ state.axis
        flat = from_point - along[:, np.newaxis] * state.axis
        lengths = np.linalg.norm(flat, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies on the axis of the cylinder; leave it out")
        outwards = (flat / lengths[:, np.newaxis]) @ np.column_stack(across(state.axis))
        design = np.column_stack(
            [-outwards, -along[:, np.newaxis] * outwards, -np.ones(len(points))]
        )
        return lengths - state.radius, design

    ends: list[tuple[_State, Floats, Floats]] = []
    reasons: list[str] = []
    for start in _cylinder_starts(cloud):
        try:
            ends.append(adjusted(start, linearised, _cylinder_moved, "cylinder"))
        except ValueError as error:
            reasons.append(str(error))
    ends = [end for end in ends if end[0].radius < _LONGEST_RADIUS]
    if not ends:
        raise ValueError((reasons or ["the points fit a plane, not a cylinder"])[0])
    return _cylinder(cloud, *min(ends, key=lambda end: float(end[1] @ end[1])))


def _cylinder_starts(cloud: Cloud) -> list[_State]:
    """Try directions of the axis, and circles of the points projected along them."""
    numbers = np.arange(_N_DIRECTIONS)
    heights = (numbers + 0.5) / _N_DIRECTIONS
    turns = numbers * np.pi * (3.0 - np.sqrt(5.0))  # a spiral of even density
    radii = np.sqrt(1.0 - heights**2)
    even = np.column_stack([radii * np.cos(turns), radii * np.sin(turns), heights])
    axes = np.concatenate([cloud.axes, even])
    frames = frames_across(axes)  # (n_directions, 3, 2)
    flat = cloud.points @ frames
    squares = np.einsum("dni,dni->dn", flat, flat)
    # |f - c|^2 = r^2 with sums of f and of squares about their means.
    flat_means, square_means = flat.mean(axis=1), squares.mean(axis=1)
    from_mean = flat - flat_means[:, np.newaxis]
    gram = 2.0 * np.einsum("dni,dnj->dij", from_mean, from_mean)
    right = np.einsum("dni,dn->di", from_mean, squares - square_means[:, np.newaxis])
    # Projected points on a line: no circle.
    wide = np.linalg.det(gram) > FLAT * np.square(np.trace(gram, axis1=1, axis2=2))
    gram[~wide] = np.eye(2)
    centres = np.linalg.solve(gram, right[:, :, np.newaxis])[:, :, 0]
    from_centre = np.linalg.norm(flat - centres[:, np.newaxis], axis=2)
    radii = np.sqrt(np.mean(np.square(from_centre), axis=1))
    misfits = np.sum(np.square(from_centre - radii[:, np.newaxis]), axis=1)
    misfits[~wide] = np.inf
    order = [index for index in np.argsort(misfits).tolist() if wide[index]]
    found = [
        _State(frames[index] @ centres[index], axes[index], float(radii[index]))
        for index in order
    ]
    chosen: list[_State] = []
    for state in found:  # no two from the same valley, if there are others
        if all(abs(state.axis @ other.axis) < 0.97 for other in chosen):
            chosen.append(state)
        if len(chosen) == _N_STARTS:
            break
    return chosen


def _cylinder_moved(state: _State, step: Floats) -> _State:
    first, second = across(state.axis)
    axis = state.axis + step[2] * first + step[3] * second
    axis = axis / np.linalg.norm(axis)
    point = state.point + step[0] * first + step[1] * second
    # Of the axis, the point nearest to the mean, which is the origin here.
    return _State(point - (point @ axis) * axis, axis, state.radius + float(step[4]))


def _cylinder(
    cloud: Cloud, state: _State, distances: Floats, design: Floats
) -> Cylinder:
    first, second = across(state.axis)
    axis = turned_positive(state.axis)
    known = np.zeros((7, 5))
    known[:3, 0], known[:3, 1], known[6, 4] = first, second, 1.0
    turned = np.sign(axis @ state.axis) / cloud.extent_mm
    known[3:6, 2], known[3:6, 3] = turned * first, turned * second
    return Cylinder(
        cloud.mean_mm + cloud.extent_mm * state.point,
        axis,
        cloud.extent_mm * state.radius,
        *cloud.quality("cylinder", distances, design, known),
    )
