"""Names of the rotations that the common points determine weakly."""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.shape import Shape, direction_text
from traverse.kinematics.helmert.volume import VolumeError
from traverse.lab.alignment.result import AlignmentTest, AlignmentWarning, PointResult
from traverse.lab.alignment.touches import CommonPoints
from traverse.lab.report.templates import Words

WORDS = Words("alignment/warnings.jinja", direction=direction_text)

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
    on_line = abs(float(about @ shape.axes[0])) > 0.9
    return WORDS.undetermined(shape, on_line, about, std_rad)


def disposition_flags(shape: Shape, index: VolumeError) -> Iterator[AlignmentWarning]:
    """Flag points nearly on a line, in a plane, or far from the volume."""
    nearly_straight = shape.straightness < STRAIGHT
    if nearly_straight:
        text = WORDS.nearly_collinear(shape)
        yield AlignmentWarning("nearly_collinear", text, shape.axes[0])
    if shape.n == 3 or (shape.kind == "plane" and not nearly_straight):
        yield AlignmentWarning("coplanar", WORDS.coplanar(shape), shape.axes[2])
    if index.rms_mm > POOR_INDEX:
        text = WORDS.small_for_the_volume(index)
        yield AlignmentWarning("small_for_the_volume", text)


def scatter_flags(common: CommonPoints) -> Iterator[AlignmentWarning]:
    """Flag names whose touches are farther apart than their errors explain."""
    wide = []
    for name, *places in zip(
        common.names, common.measured, common.nominal, strict=True
    ):
        for place in places:
            covariance = place.covariance_mm2
            limit_mm = _MOST_SCATTER_MM
            if covariance is not None and np.any(covariance):
                limit_mm = _MOST_SCATTER * float(np.sqrt(np.trace(covariance)))
            if place.spread_mm is not None and place.spread_mm > limit_mm:
                wide.append((name, place.spread_mm))
                break  # once is enough
    if wide:
        text = WORDS.scattered_touches(wide)
        yield AlignmentWarning("scattered_touches", text)


def scale_flags(scale: float) -> Iterator[AlignmentWarning]:
    """Flag a scale that no temperature explains."""
    if abs(scale - 1.0) > _MOST_STRETCH:
        yield AlignmentWarning("unlikely_scale", WORDS.unlikely_scale(scale))


def revealed_flags(
    test: AlignmentTest | None, points: Sequence[PointResult], *, is_stated: bool
) -> Iterator[AlignmentWarning]:
    """Flag what the tests say, and what they cannot say."""
    if test is None:
        yield AlignmentWarning("no_redundancy", WORDS.no_redundancy())
    elif not is_stated:
        yield AlignmentWarning("errors_not_stated", WORDS.errors_not_stated(test))
    elif not test.passed:
        yield AlignmentWarning("global_test_failed", WORDS.global_test_failed(test))
    blind = [point.name for point in points if point.detectable_mm.worst is None]
    if blind and test is not None:
        text = WORDS.blind_directions([] if len(blind) == len(points) else blind)
        yield AlignmentWarning("blind_directions", text)
