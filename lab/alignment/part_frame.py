"""Frames of a part by plane, line and point, and how errors of touches move them."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.fits import fit_plane
from traverse.kinematics.helmert.transformation import N_RIGID, Helmert, motions
from traverse.lab.alignment.nominal import Nominal

_STRAIGHT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PartFrame:
    """A frame.

    Attributes:
        origin_mm: (3,).
        axes: Unit vectors as columns: along the line, across it, off the plane, (3, 3).
    """

    origin_mm: Floats
    axes: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PlaneLinePointTouches:
    """The touches of the three features in their order, (n, 3): at least 3, 2 and 1.

    Those of the line go from its start to its end.
    """

    plane_mm: Floats
    line_mm: Floats
    point_mm: Floats

    @property
    def all_mm(self) -> Floats:
        """All of them, (n, 3)."""
        return np.concatenate([self.plane_mm, self.line_mm, self.point_mm])


def measured_frame(touched: PlaneLinePointTouches, upwards: Floats) -> PartFrame:
    """Fit the frame of the touches.

    Its normal is on the side of the plane that is upwards, (3,).

    Raises:
        ValueError: The touches of a feature do not make one.
    """
    plane = fit_plane(touched.plane_mm)
    normal = plane.normal * np.sign(plane.normal @ upwards)
    mean_mm = touched.line_mm.mean(axis=0)
    flat_mm = touched.line_mm - mean_mm
    flat_mm = flat_mm - np.outer(flat_mm @ normal, normal)
    _, sizes_mm, rows = np.linalg.svd(flat_mm)
    length_mm = float(np.linalg.norm(np.ptp(touched.line_mm, axis=0)))
    if not sizes_mm[0] > _STRAIGHT * (1.0 + length_mm):
        raise ValueError(
            "the touches of the line lie above one another, seen along the plane's "
            "normal: the rotation about the normal is undetermined; touch it at both "
            "ends"
        )
    if not sizes_mm[1] < 0.5 * sizes_mm[0]:
        raise ValueError(
            "the touches of the line are nearly as wide as they are long, seen along "
            "the plane's normal; touch it at both ends"
        )
    forwards = flat_mm[-1] - flat_mm[0]
    direction = rows[0] * np.sign(rows[0] @ forwards)
    return _frame(
        plane.point_mm, normal, mean_mm, direction, touched.point_mm.mean(axis=0)
    )


def nominal_frame(nominal: Nominal) -> PartFrame:
    """Make the frame of the nominal features.

    Raises:
        ValueError: A feature is not there.
    """
    plane, line, point = nominal.plane, nominal.line, nominal.point
    if plane is None or line is None or point is None:
        tables = {"[plane]": plane, "[line]": line, "[point]": point}
        lacking = ", ".join(name for name, value in tables.items() if value is None)
        raise ValueError(f"3-2-1 needs {lacking} in the nominal file (TOML); add it")
    normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
    direction = np.array(line.direction)
    direction = direction - (direction @ normal) * normal
    direction /= np.linalg.norm(direction)
    return _frame(
        np.array(plane.point_mm),
        normal,
        np.array(line.point_mm),
        direction,
        np.array(point.point_mm),
    )


def _frame(
    on_plane_mm: Floats,
    normal: Floats,
    on_line_mm: Floats,
    direction: Floats,
    stop_mm: Floats,
) -> PartFrame:
    axes = np.column_stack([direction, np.cross(normal, direction), normal])
    # Each coordinate is determined by the feature that fixes it.
    origin = np.array(
        [stop_mm @ axes[:, 0], on_line_mm @ axes[:, 1], on_plane_mm @ axes[:, 2]]
    )
    return PartFrame(axes @ origin, axes)


def transformation_between(measured: PartFrame, nominal: PartFrame) -> Helmert:
    """Put the measured frame onto the nominal one."""
    rotation = nominal.axes @ measured.axes.T
    return Helmert(rotation, nominal.origin_mm - rotation @ measured.origin_mm)


def local_heights(
    touched: PlaneLinePointTouches, frame: PartFrame
) -> tuple[Floats, Integers, Floats]:
    """Return the fitted part of every touch.

    Returns:
        The touches in the frame, (n, 3); which of its axes counts, (n,): off the plane
        2, across the line 1, along it 0; and the residuals of the fits, (n,).
    """
    numbers = [len(touched.plane_mm), len(touched.line_mm), len(touched.point_mm)]
    axis = np.repeat([2, 1, 0], numbers)
    local_mm = (touched.all_mm - frame.origin_mm) @ frame.axes
    return local_mm, axis, local_mm[np.arange(len(axis)), axis]


def sensitivity(local_mm: Floats, axis: Integers) -> Floats:
    """Return how errors of touches move the transformation.

    Args:
        local_mm: The touches in the frame, (n, 3).
        axis: Which of its axes counts, (n,).

    Returns:
        xi about the frame's origin, written in the frame, by the coordinate of each
        touch along its axis: (6, n).
    """
    plane, line, point = (np.flatnonzero(axis == which) for which in (2, 1, 0))
    moves = np.zeros((N_RIGID, len(axis)))
    # Heights e of the plane are fitted by a + b x + c y; xi takes that away again.
    design = np.column_stack([np.ones(len(plane)), local_mm[plane, :2]])
    height, slope_x, slope_y = np.linalg.pinv(design)
    moves[2, plane] = -height
    moves[3, plane] = -slope_y
    moves[4, plane] = slope_x
    # Across the line: e less what the turn about the line does to touches at a height.
    design = np.column_stack([np.ones(len(line)), local_mm[line, 0]])
    fit = np.linalg.pinv(design)
    of_line = np.zeros((len(line), len(axis)))
    of_line[np.arange(len(line)), line] = 1.0
    of_line -= np.outer(local_mm[line, 2], moves[3])
    shift, turn = fit @ of_line
    moves[1], moves[5] = -shift, -turn
    # Along the line: the mean, less what both other turns do to the point.
    mean_mm = local_mm[point].mean(axis=0)
    moves[0, point] = -1.0 / len(point)
    moves[0] += -moves[4] * mean_mm[2] + moves[5] * mean_mm[1]
    return moves


def residual_map(local_mm: Floats, axis: Integers, moves: Floats) -> Floats:
    """Return what an error of each touch does to the residual of each.

    Args:
        local_mm: The touches in the frame, (n, 3).
        axis: Which of its axes counts, (n,).
        moves: See `sensitivity`, (6, n).

    Returns:
        (n, n), of rank n - 6; its diagonal are the redundancy numbers.
    """
    along = motions(local_mm, N_RIGID)[np.arange(len(axis)), axis]
    mapped: Floats = np.eye(len(axis)) + along @ moves
    return np.where(np.abs(mapped) > 1e-9, mapped, 0.0)
