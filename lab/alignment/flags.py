"""Names of the rotations that the common points determine weakly."""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.shape import Shape, direction_text
from traverse.kinematics.helmert.volume import VolumeError
from traverse.lab.alignment.result import AlignmentTest, AlignmentWarning, PointResult
from traverse.lab.alignment.touches import CommonPoints

# A rotation with more uncertainty counts as unknown: 0.1 rad, a tenth of distances.
UNKNOWN_RAD = 0.1
STRAIGHT = 0.15
POOR_INDEX = 3.0
_MOST_STRETCH = 0.005  # aluminium over 200 K
_MOST_SCATTER = 5.0  # times the stated error of a place
_MOST_SCATTER_MM = 0.5  # where none is stated


def turn_problem(covariance: Floats, shape: Shape) -> str | None:
    """Name the rotation that is undetermined within its errors, or None."""
    sizes, vectors = np.linalg.eigh(covariance[3:6, 3:6])
    std_rad = float(np.sqrt(max(sizes[-1], 0.0)))
    if not std_rad > UNKNOWN_RAD:
        return None
    about = vectors[:, -1] * np.sign(vectors[np.argmax(np.abs(vectors[:, -1])), -1])
    cause = (
        f"the {shape.n} common points lie on one line within their errors"
        if abs(float(about @ shape.axes[0])) > 0.9
        else f"the {shape.n} common points lie too close together for their errors"
    )
    return (
        f"{cause}: the rotation about the direction {direction_text(about)} is known "
        f"to {std_rad:.2g} rad only, which is undetermined; measure at least one more "
        "point, far beside them"
    )


def disposition_flags(shape: Shape, index: VolumeError) -> Iterator[AlignmentWarning]:
    """Flag points nearly on a line, in a plane, or far from the volume."""
    nearly_straight = shape.straightness < STRAIGHT
    if nearly_straight:
        along = shape.axes[0]
        yield AlignmentWarning(
            "nearly_collinear",
            f"the {shape.n} common points are nearly collinear (they lie within "
            f"{shape.straightness:.1%} of their length): the rotation about the "
            f"direction {direction_text(along)} is hardly determined, and no residual "
            "shows it; measure a point far beside the line",
            along,
        )
    if shape.n == 3 or (shape.kind == "plane" and not nearly_straight):
        across = shape.axes[2]
        what = (
            "three points always lie in a plane: no error across it can be revealed"
            if shape.n == 3
            else f"the {shape.n} common points are coplanar: they cannot tell a part "
            "from its mirror image, and tilts follow from heights alone"
        )
        yield AlignmentWarning(
            "coplanar", f"{what} (normal {direction_text(across)})", across
        )
    if index.rms_mm > POOR_INDEX:
        yield AlignmentWarning(
            "small_for_the_volume",
            f"places in the volume are {index.rms_mm:.1f} times as uncertain as a "
            f"common point, {index.max_mm:.1f} times at its worst place: the points "
            "span too little of the volume; measure points at its far ends",
        )


def scatter_flags(common: CommonPoints) -> Iterator[AlignmentWarning]:
    """Flag names whose touches are farther apart than their errors explain."""
    wide = []
    for name, places in zip(
        common.names, zip(common.measured, common.nominal, strict=True), strict=True
    ):
        for place in places:
            covariance = place.covariance_mm2
            limit_mm = _MOST_SCATTER_MM
            if covariance is not None and np.any(covariance):
                limit_mm = _MOST_SCATTER * float(np.sqrt(np.trace(covariance)))
            if place.spread_mm is not None and place.spread_mm > limit_mm:
                wide.append(f"{name} ({place.spread_mm:.3g} mm)")
                break  # once is enough
    if wide:
        yield AlignmentWarning(
            "scattered_touches",
            f"touches of one name lie far apart: {', '.join(wide)}: a name was given "
            "twice, or they are touches of a surface; give each point its own name, or "
            "--spheres where they lie on spheres",
        )


def scale_flags(scale: float) -> Iterator[AlignmentWarning]:
    """Flag a scale that no temperature explains."""
    if abs(scale - 1.0) > _MOST_STRETCH:
        yield AlignmentWarning(
            "unlikely_scale",
            f"the scale is {scale:.6g}, further from 1 than temperature explains: look "
            "at the units of both sides, and at names",
        )


def revealed_flags(
    test: AlignmentTest | None, points: Sequence[PointResult], *, is_stated: bool
) -> Iterator[AlignmentWarning]:
    """Flag what the tests say, and what they cannot say."""
    if test is None:
        yield AlignmentWarning(
            "no_redundancy",
            "there is no redundancy: no error of any point can be revealed",
        )
    elif not is_stated:
        yield AlignmentWarning(
            "errors_not_stated",
            "no errors of the points are stated: sigma0 is their estimate from "
            f"{test.redundancy} redundant coordinates, and tests nothing; state them "
            "with --std",
        )
    elif not test.passed:
        yield AlignmentWarning(
            "global_test_failed",
            f"residuals are {test.sigma0:.2f} times as large as the stated errors let "
            f"expect (p = {test.p_value:.2g}): a point is wrong, a name is exchanged, "
            "the part is deformed, or errors are larger than stated",
        )
    blind = [point.name for point in points if point.detectable_mm[1] is None]
    if blind and test is not None:
        whose = "every point" if len(blind) == len(points) else ", ".join(blind)
        yield AlignmentWarning(
            "blind_directions",
            f"of {whose} there is a direction in which an error, however large, "
            "cannot be revealed; the directions stand with the points",
        )
