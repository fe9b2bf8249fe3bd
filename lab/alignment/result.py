"""An alignment as computed, its tests, and alignment.json as plain values.

Words and page are made of these values, schema traverse/alignment/1.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special

from traverse.arrays import Floats
from traverse.kinematics.helmert.shape import Shape, direction_text
from traverse.kinematics.helmert.transformation import PARAMETERS, Helmert
from traverse.kinematics.helmert.volume import (
    Ball,
    Volume,
    VolumeError,
    place_covariances,
    volume_error,
)
from traverse.lab.alignment.touches import CommonPoints
from traverse.lab.outcomes.alignment import (
    TITLES,
    AlignmentEvidence,
    alignment_outcome,
)
from traverse.lab.outcomes.base import Outcome
from traverse.lab.report.provenance import (
    ReportProvenance,
    ReportSource,
    report_provenance,
)
from traverse.lab.report.quantities import picked, plain_values
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
        test = self.test
        return alignment_outcome(
            AlignmentEvidence(
                sigma0=None if test is None else test.sigma0,
                redundancy=0 if test is None else test.redundancy,
                p_value=None if test is None else test.p_value,
                passed=None if test is None else test.passed,
                warnings=[(flag.code, flag.text) for flag in self.flags],
            )
        )


def volume_values(volume: Volume, source: str) -> dict[str, Any]:
    """Write a volume as in alignment.json."""
    if isinstance(volume, Ball):
        shape = {"centre_mm": volume.mean_mm.tolist(), "radius_mm": volume.radius_mm}
        return {"kind": "ball", **shape, "source": source}
    corners = {"min_mm": volume.low_mm.tolist(), "max_mm": volume.high_mm.tolist()}
    return {"kind": "box", **corners, "source": source}


SCHEMA = "traverse/alignment/1"


def alignment_values(
    result: AlignmentResult,
    *,
    name: str,
    arm: str | None,
    measured: str,
    nominal: str,
    provenance: ReportProvenance | None = None,
) -> dict[str, Any]:
    """Put everything into plain values; computed by this user now if not said."""
    origin = provenance or report_provenance(ReportSource(measured, ""))
    transformation, test, outcome = result.transformation, result.test, result.outcome
    return {
        "schema": SCHEMA,
        "method": result.method,
        "date_utc": origin.date_utc,
        "provenance": origin.values,
        "arm": arm,
        "measured": measured,
        "nominal": nominal,
        # As the command `align` takes it.
        "alignment": {
            "action": "set",
            "name": name,
            "rotation": transformation.rotation.tolist(),
            "translation_mm": transformation.translation_mm.tolist(),
            "scale": transformation.scale,
        },
        **plain_values(outcome),
        "verdict": TITLES[outcome.state],
        "passed": result.is_good,
        "covariance": None
        if result.covariance is None
        else covariance_values(result.covariance, result.centre_mm),
        "errors_stated": result.is_stated,
        "sigma0": None if test is None else test.sigma0,
        "sigma0_unit": "1" if result.is_stated else "mm",
        "sigma0_interval": None if test is None else list(test.interval),
        "redundancy": 0 if test is None else test.redundancy,
        "global_test": None if test is None else test.values(),
        "point_test": {"level": POINT_LEVEL, "power": POWER},
        "quality": {
            "volume": volume_values(result.volume, result.volume_source),
            "index": error_values(result.index),
            **predicted_values(result.volume, result.centre_mm, result.covariance),
        },
        **picked(result, "points", "features", "flags", "remarks"),
    }


def covariance_values(covariance: Floats, centre_mm: Floats) -> dict[str, Any]:
    variances = np.maximum(np.diag(covariance), 0.0)
    return {
        "parameters": list(PARAMETERS[: len(covariance)]),
        "centre_mm": centre_mm.tolist(),
        "matrix": covariance.tolist(),
        "std": np.sqrt(variances).tolist(),
    }


def predicted_values(
    volume: Volume, centre_mm: Floats, covariance: Floats | None
) -> dict[str, Any]:
    """Return the errors in a volume, and at its middle and its corners."""
    if covariance is None:
        return {"predicted_error_mm": None, "places": []}
    places_mm = np.vstack([volume.mean_mm, volume.corners_mm])
    errors = place_covariances(places_mm, centre_mm, covariance)
    return {
        "predicted_error_mm": error_values(volume_error(volume, centre_mm, covariance)),
        "places": [
            {
                "place_mm": place.tolist(),
                "rms_mm": float(np.sqrt(np.trace(error))),
                "covariance_mm2": error.tolist(),
            }
            for place, error in zip(places_mm, errors, strict=True)
        ],
    }


def error_values(error: VolumeError) -> dict[str, Any]:
    at_mm = error.max_at_mm.tolist()
    return {"rms": error.rms_mm, "max": error.max_mm, "max_at_mm": at_mm}


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
