"""An alignment as computed, and what its tests say of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from traverse.arrays import Floats
from traverse.kinematics.helmert.shape import Shape, direction_text
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import (
    Volume,
    VolumeError,
)
from traverse.lab.alignment.touches import CommonPoints
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    judge,
)
from traverse.lab.report.quantities import picked
from traverse.lab.report.templates import Words
from traverse.lab.statistics.distributions import GLOBAL_LEVEL, GlobalTest

# W. Baarda's usual choice for one coordinate: 0.1 % false alarms, 80 % found.
POINT_LEVEL = 0.001
POWER = 0.8
# Errors of one coordinate that are found so, in standard deviations of what is seen.
FOUND = float(special.ndtri(1.0 - 0.5 * POINT_LEVEL) + special.ndtri(POWER))


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentTest(GlobalTest):
    """The global test of an alignment, one-sided, and what it could have revealed.

    Attributes:
        sigma0: Found over stated; or, where nothing is stated, in mm.
        redundancy: Of sigma0.
        interval: In which the true sigma0 lies with 95 %.
        found_factor: So many times too large errors have to be all over to be found
            with a probability of 80 %.
        found_noncentrality: What an error has to add to the sum of squares for that.
    """

    sigma0: float
    redundancy: int
    interval: tuple[float, float]
    found_factor: float
    found_noncentrality: float

    def values(self) -> dict[str, Any]:
        return {
            "level": GLOBAL_LEVEL,
            "power": POWER,
            **picked(self, "p_value", "passed", "found_noncentrality"),
            "found_factor": None if self.p_value is None else self.found_factor,
        }


def global_test(
    sum_of_squares: float, redundancy: int, *, is_stated: bool
) -> AlignmentTest | None:
    """Test whether a weighted sum of squares is chi-squared; None without redundancy.

    There is no p-value where the weights are just ratios, not stated errors.
    """
    if redundancy <= 0:
        return None
    sigma0 = float(np.sqrt(sum_of_squares / redundancy))
    p_value = float(special.chdtrc(redundancy, sum_of_squares))
    low, high = (float(special.chdtri(redundancy, p)) for p in (0.975, 0.025))
    critical = float(special.chdtri(redundancy, GLOBAL_LEVEL))
    return AlignmentTest(
        sigma0=sigma0,
        redundancy=redundancy,
        interval=(
            sigma0 * np.sqrt(redundancy / high),
            sigma0 * np.sqrt(redundancy / low),
        ),
        p_value=p_value if is_stated else None,
        found_factor=float(np.sqrt(critical / special.chdtri(redundancy, POWER))),
        found_noncentrality=float(special.chndtrinc(critical, redundancy, 1.0 - POWER)),
    )


def point_p_value(statistic: float, degrees: int) -> float | None:
    """Test a point; None where its redundancy is zero."""
    return float(special.chdtrc(degrees, statistic)) if degrees else None


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentWarning:
    """A warning to be read before the alignment is used.

    Its direction, if any, is in the system that the alignment leads to, (3,).
    """

    code: str
    text: str
    direction: Floats | None = None


@dataclass(frozen=True, slots=True)
class Detectable:
    """Least error of a point that is found, in the best and the worst direction."""

    best: float | None
    worst: float | None


@dataclass(frozen=True, slots=True, eq=False)
class PointResult:
    """A common point, or a touch of a feature.

    Attributes:
        nominal_mm: In the system that it leads to, (3,); None of touches on features.
        residual_mm: Nominal less transformed, (3,).
        touches: How many it is the mean of.
        redundancy: Of each coordinate, (3,).
        p_value: Of its residuals; None without redundancy.
        detectable_mm: None where an error cannot be found, however large.
        worst_direction: Of the error that is found worst, (3,).
        hidden_in_volume_mm: What an error that is just not found does to the volume, at
            the worst; None where there is no limit to it.
        hidden_in_volume_per_mm: The same per mm of an error in the worst direction.
    """

    name: str
    nominal_mm: Floats | None
    residual_mm: Floats
    residual_length_mm: float
    touches: int
    spread_mm: float | None
    redundancy: Floats
    p_value: float | None
    detectable_mm: Detectable
    worst_direction: Floats
    hidden_in_volume_mm: float | None
    hidden_in_volume_per_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentResult:
    """An alignment, and what it is worth.

    Attributes:
        method: `best-fit`, `3-2-1` or `leapfrog`.
        centre_mm: Reference point of the covariance, (3,).
        covariance: Of xi, (p, p); None where the errors are unknown.
        is_stated: Whether errors are stated; else they are estimated from residuals.
        test: Of sigma0; None without redundancy.
        volume: Where it is used, in the system it leads to.
        index: Of the points' disposition for that volume.
    """

    method: str
    transformation: Helmert
    centre_mm: Floats
    covariance: Floats | None
    is_stated: bool
    points: tuple[PointResult, ...]
    test: AlignmentTest | None
    volume: Volume
    volume_source: str
    index: VolumeError
    flags: tuple[AlignmentWarning, ...]
    remarks: tuple[str, ...]
    features: tuple[dict[str, Any], ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether no test failed."""
        return self.test is None or self.test.passed is not False

    @property
    def outcome(self) -> Outcome:
        return judge(CONDITIONS, self)


_TESTED = ("no_redundancy", "errors_not_stated", "global_test_failed")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].strip()}."


def _tested(result: AlignmentResult) -> Finding:
    test = result.test
    values = {
        "sigma0": None if test is None else test.sigma0,
        "redundancy": 0 if test is None else test.redundancy,
        "p_value": None if test is None else test.p_value,
    }
    state = State.DOUBT if result.is_good else State.BAD
    shortfalls = [
        Shortfall(_sentence(flag.text), "", {**values, "flag": flag.code}, state)
        for flag in result.flags
        if flag.code in _TESTED
    ]
    if test is not None and test.passed and not shortfalls:
        return Established(values)
    return shortfalls


def _well_placed(result: AlignmentResult) -> Finding:
    return [
        Shortfall(_sentence(flag.text), "", {"flag": flag.code})
        for flag in result.flags
        if flag.code not in _TESTED
    ] or Established()


CONDITIONS: tuple[Condition[AlignmentResult], ...] = (
    Condition("tested", "residuals are as large as the stated errors allow", _tested),
    Condition("points", "points determine it well and fit each other", _well_placed),
)


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
