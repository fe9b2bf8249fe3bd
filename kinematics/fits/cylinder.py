"""A cylinder: the distance from the axis less the radius.

The sum of squares has several valleys. For a given direction of the axis the points,
projected along it, lie on a circle, whose algebraic fit is closed: directions over a
half sphere and the principal ones of the cloud are tried so, the best few are starts
of Gauss-Newton steps, and the lowest end counts.
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


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    point: Floats
    axis: Floats
    radius: float


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

    best: tuple[float, _State] | None = None
    reasons: list[str] = []
    for start in _starts(cloud):
        try:
            state = adjusted(start, linearised, _moved, "cylinder")
        except ValueError as error:
            reasons.append(str(error))
            continue
        squares = float(np.sum(np.square(linearised(state)[0])))
        if state.radius < _LONGEST_RADIUS and (best is None or squares < best[0]):
            best = squares, state
    if best is None:
        raise ValueError((reasons or ["the points fit a plane, not a cylinder"])[0])
    return _cylinder(cloud, best[1], *linearised(best[1]))


def _starts(cloud: Cloud) -> list[_State]:
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


def _moved(state: _State, step: Floats) -> _State:
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
    squares_mm2 = cloud.extent_mm**2 * float(distances @ distances)
    return Cylinder(
        cloud.mean_mm + cloud.extent_mm * state.point,
        axis,
        cloud.extent_mm * state.radius,
        *cloud.quality("cylinder", design, known, squares_mm2),
    )
