"""3-2-1: a plane, a line and a point bring the part into its system.

The plane's normal is the third axis; the line, projected along it, gives the first; the
point, projected onto the line, is the origin. Everything is a fit of least squares that
follows from the one before it, so its errors are linear in those of the touches: the
plane leaves out 3 freedoms, the line 2 of what is left, the point the last.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.helmert.shape import shape_of
from traverse.kinematics.helmert.volume import VolumeError, mean_motions
from traverse.kinematics.helmert.volume import volume_error as error_in
from traverse.lab.alignment.nominal import Nominal, VolumeFunction
from traverse.lab.alignment.part_frame import (
    PartFrame,
    PlaneLinePointTouches,
    local_heights,
    measured_frame,
    nominal_frame,
    residual_map,
    sensitivity,
    transformation_between,
)
from traverse.lab.alignment.result import (
    FOUND,
    POOR_INDEX,
    STRAIGHT,
    WORDS,
    AlignmentResult,
    AlignmentWarning,
    Detectable,
    PointResult,
    global_test,
    point_p_value,
    revealed_flags,
    turn_problem,
)
from traverse.lab.alignment.touches import Touch, places_mm, stated_errors
from traverse.plurals import counted

_AXES = ("along the line", "across the line", "off the plane")


def _plane_flags(index: VolumeError, on_plane_mm: Floats) -> Iterator[AlignmentWarning]:
    """Flag what the touches of the plane, (n, 3), leave weak."""
    shape = shape_of(on_plane_mm)
    if shape.straightness < STRAIGHT:
        text = WORDS.nearly_collinear_plane(shape)
        yield AlignmentWarning("nearly_collinear", text, shape.axes[0])
    if index.rms_mm > POOR_INDEX:
        text = WORDS.small_for_the_volume_plane(index)
        yield AlignmentWarning("small_for_the_volume", text)


def _centre_flags(touches: Sequence[Touch]) -> Iterator[AlignmentWarning]:
    """Flag places that are not on the surfaces of the nominal file."""
    off_mm = max((touch.off_mm or 0.0 for touch in touches), default=0.0)
    if off_mm > 0.0:
        yield AlignmentWarning("ball_centres", WORDS.ball_centres(off_mm))


def _feature_values(
    nominal: Nominal, axis: Integers, heights_mm: Floats
) -> Iterator[dict[str, Any]]:
    """Return how the features fit."""
    for kind, which, freedoms in (("plane", 2, 3), ("line", 1, 2), ("point", 0, 1)):
        rows = heights_mm[axis == which]
        feature = getattr(nominal, kind)
        yield {
            "kind": kind,
            "feature": feature.feature,
            "touches": len(rows),
            "counts": _AXES[which],
            "redundancy": len(rows) - freedoms,
            "rms_mm": float(np.sqrt(np.mean(rows**2))),
        }


_SIDE = 0.3  # mean cosine of shanks and normal, from which on they decide its side


def align_plane_line_point(
    touches: Sequence[Touch],
    nominal: Nominal,
    volume_of: VolumeFunction,
    volume_source: str,
    *,
    std_mm: float | None,
) -> AlignmentResult:
    """Align by plane, line and point; the touches of the line are in their order.

    Each coordinate of a touch has the standard deviation; None: as the touches say.

    Raises:
        ValueError: A feature is not there, not touched often enough, or touched so that
            something is left open.
    """
    goal = nominal_frame(nominal)
    groups = _groups(touches, nominal)
    everything = [touch for group in groups for touch in group]
    touched = PlaneLinePointTouches(*map(places_mm, groups))
    frame = measured_frame(touched, _upwards(groups, touched, nominal, goal))
    transformation = transformation_between(frame, goal)
    on_plane_mm = transformation.places_mm(touched.plane_mm)
    local_mm, axis, heights_mm = local_heights(touched, frame)
    moves = sensitivity(local_mm, axis)
    errors = stated_errors(everything, std_mm)
    is_stated = errors is not None
    redundancy = len(axis) - 6
    mapped = residual_map(local_mm, axis, moves)
    of_touches = np.eye(len(axis))
    if errors is not None:
        # The direction that counts of each touch, in the arm's system.
        weights = np.einsum("rn,na->rna", of_touches, np.eye(3)[axis] @ frame.axes.T)
        of_touches, _ = errors.combined(weights)
    of_residuals = mapped @ of_touches @ mapped.T
    squares = _sum_of_squares(heights_mm, of_residuals, redundancy)
    test = global_test(squares, redundancy, is_stated=is_stated)
    trusted = is_stated and (test is None or bool(test.passed))
    factor = 1.0 if trusted else (None if test is None else test.sigma0)
    to_part = np.zeros((6, 6))
    to_part[:3, :3] = to_part[3:, 3:] = goal.axes
    moves = to_part @ moves
    covariance = None
    if factor is not None:
        covariance = factor**2 * moves @ of_touches @ moves.T
        problem = turn_problem(covariance, shape_of(on_plane_mm))
        if problem is not None:
            raise ValueError(problem.replace("common points", "touches of the plane"))
    volume = volume_of(transformation)
    error = error_in(volume, goal.origin_mm, moves @ moves.T)
    per_touch = np.sqrt(3.0)  # errors of a touch count along one axis of three
    index = VolumeError(
        error.rms_mm / per_touch, error.max_mm / per_touch, error.max_at_mm
    )
    unit = 1.0 if is_stated else (test.sigma0 if test is not None else 0.0)
    mean = mean_motions(volume, goal.origin_mm, 6)
    in_volume = np.sqrt(np.einsum("pn,pq,qn->n", moves, mean, moves))
    points = tuple(
        _point(
            touch,
            goal.axes[:, axis[row]],
            residual_mm=-heights_mm[row],
            share=float(mapped[row, row]),
            std_mm=unit * float(np.sqrt(of_residuals[row, row])),
            in_volume=float(in_volume[row]),
            is_stated=is_stated,
        )
        for row, touch in enumerate(everything)
    )
    flags = [
        *_plane_flags(index, on_plane_mm),
        *_centre_flags(everything),
        *revealed_flags(test, points, is_stated=is_stated),
    ]
    return AlignmentResult(
        method="3-2-1",
        transformation=transformation,
        centre_mm=goal.origin_mm,
        covariance=covariance,
        is_stated=is_stated,
        points=points,
        test=test,
        volume=volume,
        volume_source=volume_source,
        index=index,
        flags=tuple(flags),
        remarks=(
            "each touch counts in one direction only: off the plane, across the line, "
            "along the line; errors in the others change nothing",
        ),
        features=tuple(_feature_values(nominal, axis, heights_mm)),
    )


def _point(
    touch: Touch,
    way: Floats,
    *,
    residual_mm: float,
    share: float,
    std_mm: float,
    in_volume: float,
    is_stated: bool,
) -> PointResult:
    """Compute the effect of an undetected error of a touch along its way; test it.

    The standard deviation is of its residual, which shows that share of an error.
    """
    least_mm = FOUND * std_mm / share if share else None
    statistic = (residual_mm / std_mm) ** 2 if share else 0.0
    return PointResult(
        name=touch.names[0],
        nominal_mm=None,
        residual_mm=residual_mm * way,
        residual_length_mm=float(np.linalg.norm(residual_mm * way)),
        touches=1,
        spread_mm=None,
        redundancy=share * way**2,
        detectable_mm=Detectable(least_mm, least_mm),
        worst_direction=way,
        hidden_in_volume_mm=None if least_mm is None else least_mm * in_volume,
        hidden_in_volume_per_mm=in_volume,
        p_value=point_p_value(float(statistic), int(share > 0.0))
        if is_stated
        else None,
    )


def _sum_of_squares(residuals_mm: Floats, covariance_mm2: Floats, rank: int) -> float:
    """Return e' C^+ e, chi-squared with as many degrees of freedom as C has rank."""
    if rank <= 0:
        return 0.0
    sizes, vectors = np.linalg.eigh(covariance_mm2)
    parts = residuals_mm @ vectors[:, -rank:]
    return float(np.sum(parts**2 / sizes[-rank:]))


def _groups(touches: Sequence[Touch], nominal: Nominal) -> list[list[Touch]]:
    """Sort touches by feature: plane, line, point."""
    groups = []
    problems = []
    for kind, feature, least in (
        ("plane", nominal.plane, 3),
        ("line", nominal.line, 2),
        ("point", nominal.point, 1),
    ):
        name = "" if feature is None else feature.feature
        group = [touch for touch in touches if name in touch.names]
        if len(group) < least:
            problems.append(
                f"the {kind} '{name}' has {counted(len(group), 'touch')}, expected at "
                f"least {least}"
            )
        groups.append([replace(touch, names=(name,)) for touch in group])
    if problems:
        raise ValueError("; ".join(problems))
    return groups


def _upwards(
    groups: Sequence[Sequence[Touch]],
    touched: PlaneLinePointTouches,
    nominal: Nominal,
    goal: PartFrame,
) -> Floats:
    """Determine the outside of the plane: the shank is outside the part.

    Where no shanks are known, by the side on which line or point are nominally.
    """
    shanks = [touch.shank for touch in groups[0]]
    known = [shank for shank in shanks if shank is not None]
    heights_mm = touched.plane_mm - touched.plane_mm.mean(axis=0)
    normal = np.linalg.svd(heights_mm)[2][2]
    if len(known) == len(shanks):
        upwards: Floats = -np.mean(known, axis=0)
        if abs(float(upwards @ normal)) > _SIDE:
            return upwards
    spread_mm = float(np.std(heights_mm @ normal))
    beside = []
    for at_mm, feature in (
        (touched.line_mm, nominal.line),
        (touched.point_mm, nominal.point),
    ):
        if feature is not None:
            away = np.array(feature.point_mm) - goal.origin_mm
            beside.append((at_mm, float(away @ goal.axes[:, 2])))
    at_mm, nominal_mm = max(beside, key=lambda pair: abs(pair[1]))
    away_mm = at_mm.mean(axis=0) - touched.plane_mm.mean(axis=0)
    height_mm = float(away_mm @ normal)
    if min(abs(height_mm), abs(nominal_mm)) > max(10.0 * spread_mm, 1.0):
        return np.asarray(normal * np.sign(height_mm * nominal_mm), dtype=np.float64)
    raise ValueError(
        "the side of the plane is not told: a part and its turned image fit alike; "
        "give points with the direction of the shank (i, j, k, across the plane), or a "
        "line or point that is nominally more than 1 mm beside the plane"
    )
