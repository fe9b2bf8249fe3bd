"""Budgets of uncertainty by the GUM: lines, degrees of freedom, coverage factor.

The uncertainty of a test value is what the standard adds, not what the arm does: the
arm's errors, its repeatability included, are what is tested (in the manner of ISO/TS
23165 [K]). A budget lists the arm's lines, too: they tell by how much another test of
the same arm may differ.

    u^2  = sum c_i^2 u_i^2                          lines of different sources
    nu   = u^4 / sum (c_i u_i)^4 / nu_i             Welch and Satterthwaite, GUM G.4.1
    U    = t_p(nu) u                                nu cut to an integer

Lines of several values with the same source are of one quantity, such as the length of
a bar that stands in seven positions: they are fully correlated.

>>> certificate = Contribution("calibration", "of the certificate", 0.003)
>>> readings = Contribution("temperature", "", 0.004, evaluation="A", degrees=4.0)
>>> budget = Budget((certificate, readings))
>>> round(budget.standard_mm, 6), round(budget.degrees, 2)
(0.005, 9.77)
>>> round(budget.coverage_factor(0.95), 3)
2.262
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf, isinf, sqrt
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.lab.acceptance.limits import Standards
from traverse.lab.artefacts.materials import Expansion
from traverse.lab.artefacts.plane import Plane


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of a budget.

    Attributes:
        formula: With the numbers in it; or where to state it.
        signed_mm: Standard uncertainty of the value from it, with the sign of its
            sensitivity; None where it is required and not stated.
        source: Of which quantity it is; "" of one that no other value shares.
        evaluation: A by statistics, B by other means (GUM 4.2, 4.3).
        degrees: Of freedom; infinite of what is taken as known.
        distribution: Of the quantity; t where degrees of freedom are finite.
        of_arm: Whether it is of the arm, which is tested.
    """

    name: str
    formula: str
    signed_mm: float | None
    source: str = ""
    evaluation: Literal["A", "B"] = "B"
    degrees: float = inf
    distribution: Literal["normal", "uniform"] = "normal"
    of_arm: bool = False

    @property
    def standard_mm(self) -> float | None:
        return None if self.signed_mm is None else abs(self.signed_mm)


def required(line: Contribution, where: str) -> Contribution:
    """Make a line without which no uncertainty is stated: 0 mm is not stated.

    The line then names where to state it: the keys and their file.
    """
    if line.signed_mm:
        return line
    return replace(line, formula=f"give {where}", signed_mm=None)


IN_LIMITS = "in [standards] of the limits"


@dataclass(frozen=True, slots=True)
class Budget:
    """The standard uncertainty of a test value, line by line."""

    lines: tuple[Contribution, ...]

    @property
    def of_test(self) -> tuple[Contribution, ...]:
        """Lines without those of the arm."""
        return tuple(line for line in self.lines if not line.of_arm)

    @property
    def standard_mm(self) -> float | None:
        """Of the test value; None where a required line is not stated."""
        return _combined_mm(self.of_test)

    @property
    def with_arm_mm(self) -> float | None:
        """Of what another test would find: lines of the arm included."""
        return _combined_mm(self.lines)

    @property
    def degrees(self) -> float:
        return _effective_degrees(self.of_test)

    @property
    def degrees_with_arm(self) -> float:
        return _effective_degrees(self.lines)

    def coverage_factor(self, probability: float) -> float:
        return coverage_factor(self.degrees, probability)

    def with_lines(self, *lines: Contribution) -> "Budget":
        return Budget((*self.lines, *lines))


def _combined_mm(lines: Sequence[Contribution]) -> float | None:
    sizes_mm = [line.signed_mm for line in lines]
    if None in sizes_mm:
        return None
    return float(np.sqrt(sum((size_mm or 0.0) ** 2 for size_mm in sizes_mm)))


def _effective_degrees(lines: Sequence[Contribution]) -> float:
    total_mm = _combined_mm(lines)
    share = sum((line.signed_mm or 0.0) ** 4 / line.degrees for line in lines)
    return inf if total_mm is None or share == 0.0 else total_mm**4 / share


def coverage_factor(degrees: float, probability: float) -> float:
    """Return k by the t-distribution; the normal one for infinite degrees."""
    from traverse.lab.statistics.distributions import (  # noqa: PLC0415 - it loads scipy, which a plan does without
        normal_quantile,
        student_critical,
    )

    if isinf(degrees) or degrees > 1e6:
        return normal_quantile(0.5 + 0.5 * probability)
    return student_critical(1.0 - probability, int(degrees))


def combined(budgets: Sequence[Budget], slopes: Floats) -> Budget:
    """Draw up the budget of a function of several values.

    Args:
        budgets: Of n values.
        slopes: Derivatives of the function by them, (n,).
    """
    scaled: dict[tuple[str, str], list[tuple[float, Contribution]]] = {}
    for slope, budget in zip(slopes.tolist(), budgets, strict=True):
        for line in budget.lines:
            scaled.setdefault((line.name, line.source), []).append((slope, line))
    return Budget(tuple(_summed(parts) for parts in scaled.values()))


def _summed(parts: Sequence[tuple[float, Contribution]]) -> Contribution:
    first = parts[0][1]
    if len(parts) == 1 and parts[0][0] == 1.0:
        return first
    unstated = next((line for _, line in parts if line.signed_mm is None), None)
    if unstated is not None:
        return unstated
    each_mm = np.array([slope * (line.signed_mm or 0.0) for slope, line in parts])
    # Of one quantity they add up; of many they add in squares.
    total_mm = each_mm.sum() if first.source else np.linalg.norm(each_mm)
    of_source = f"{first.source}: " if first.source else ""
    formula = f"{of_source}of {len(parts)} values, by their slopes"
    return replace(first, formula=formula, signed_mm=float(total_mm))


def correlation(budgets: Sequence[Budget]) -> Floats:
    """Return correlation coefficients of n test values by shared sources, (n, n)."""
    lines = [budget.of_test for budget in budgets]
    sources = sorted({line.source for line in chain(*lines) if line.source})
    shared = np.zeros((len(budgets), len(sources)))
    variances = np.zeros(len(budgets))
    for row, of_value in enumerate(lines):
        for line in of_value:
            variances[row] += (line.signed_mm or 0.0) ** 2
            if line.source:
                shared[row, sources.index(line.source)] += line.signed_mm or 0.0
    scales = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    coefficients: Floats = (shared @ shared.T) / np.outer(scales, scales)
    np.fill_diagonal(coefficients, 1.0)
    return coefficients


# The half sphere that is touched of a ball that is smoothly out of round, oval above
# all, has another diameter and centre than the whole. Standard deviations as parts of
# the form error, the largest of simulated balls with deviations of degrees 2 to 8.
SMOOTH_FORM = 0.31  # of a diameter of 25 points, and between centres of two scans
SMOOTH_FORM_OF_ALL = 0.40  # of a diameter where the half sphere is covered densely


def form_factor(of_touch: float, smooth_form: float = SMOOTH_FORM) -> float:
    """Say how far the form of balls moves a value, as part of an even deviation.

    As if touches deviated each by itself, or all together smoothly, whichever is more.
    """
    return max(of_touch, smooth_form * sqrt(12.0))


@dataclass(frozen=True, slots=True)
class CertifiedValue:
    """A certified length or diameter of a standard.

    Attributes:
        identity: Of the standard: equal of one that stands in several places.
        calibration_mm: Standard uncertainty of its certificate.
        warmer_c: Its temperature less that of the certificate.
        form_factor: How far a deviation of a touched ball moves the value, as a part
            of it; None where no ball is touched.
    """

    identity: str
    length_mm: float
    calibration_mm: float
    expansion: Expansion
    warmer_c: float
    form_factor: float | None = None


def length_budget(value: CertifiedValue, standards: Standards) -> Budget:
    """Draw up the budget of the error of a certified length or diameter."""
    lines = [
        required(
            Contribution(
                "calibration",
                "of the certificate",
                value.calibration_mm,
                f"certificate of {value.identity}, {value.length_mm:g} mm",
            ),
            "distance_std_mm, radius_std_mm or points_std_mm in campaign.toml",
        ),
        *_expansion_lines(value, standards),
    ]
    if value.form_factor is not None:
        lines.append(_form_line(value.form_factor, standards))
    return Budget((*lines, fixture_line(standards)))


def _expansion_lines(
    value: CertifiedValue, standards: Standards
) -> tuple[Contribution, Contribution]:
    per_c, std_per_c = value.expansion.per_c, value.expansion.std_per_c
    length_mm, warmer_c, std_c = (
        value.length_mm,
        value.warmer_c,
        standards.temperature_std_c,
    )
    name, source = "expansion coefficient", f"expansion of {value.identity}"
    if per_c is None or not std_per_c:
        where = "give material, or expansion_per_c and expansion_std_per_c, in "
        coefficient = Contribution(name, f"{where}campaign.toml", None, source)
    else:
        coefficient = Contribution(
            name,
            f"{length_mm:g} mm x {1e6 * std_per_c:.3g}e-6/°C x {warmer_c:.2f} °C",
            length_mm * std_per_c * warmer_c,
            source,
            distribution="uniform",
        )
    thermometer = Contribution(
        "temperature",
        f"{length_mm:g} mm x {1e6 * (per_c or 0.0):.3g}e-6/°C x {std_c:g} °C",
        length_mm * (per_c or 0.0) * std_c,
        "thermometer",
        *_evaluated(standards.temperature_degrees),
    )
    if per_c:
        return coefficient, required(thermometer, f"temperature_std_c {IN_LIMITS}")
    return coefficient, replace(thermometer, formula="the standard does not expand")


def _evaluated(degrees: int | None) -> tuple[Literal["A", "B"], float]:
    """Return how it was evaluated, and its degrees of freedom."""
    return ("B", inf) if degrees is None else ("A", float(degrees))


def _form_line(factor: float, standards: Standards) -> Contribution:
    """Make the line of a ball whose surface deviates evenly within its form error."""
    form_mm = standards.form_mm
    line = Contribution(
        "form of the ball",
        f"{form_mm:g} mm / sqrt(12) x {factor:.3g}",
        form_mm / sqrt(12.0) * factor,
    )
    return required(line, f"form_mm {IN_LIMITS}")


def fixture_line(standards: Standards) -> Contribution:
    """Make the line of how firmly a standard stood."""
    evaluated = _evaluated(standards.fixture_degrees)
    return Contribution(
        "fixture", "as stated", standards.fixture_std_mm, "", *evaluated
    )


def form_budget(standards: Standards, flat: Plane | None = None) -> Budget:
    """Draw up the budget of what the form of a test sphere, or of a flat, disturbs."""
    name, where = "form of the ball", f"form_mm {IN_LIMITS}"
    form_mm, form_std_mm = standards.form_mm, standards.form_std_mm
    if flat is not None:
        name, where = "form of the flat", "form_mm of the plane in campaign.toml"
        form_mm, form_std_mm = flat.form_mm or 0.0, flat.form_std_mm
    form = Contribution(name, f"{form_mm:g} mm / 2", form_mm / 2.0)
    uncertain = Contribution("its uncertainty", "as stated", form_std_mm)
    return Budget((required(form, where), uncertain, fixture_line(standards)))


def fixture_budget(standards: Standards) -> Budget:
    """Draw up the budget of a test that needs no calibrated standard."""
    where = f"fixture_std_mm {IN_LIMITS}"
    return Budget((required(fixture_line(standards), where),))


def repeatability(
    name: str, formula: str, standard_mm: float, degrees: int
) -> Contribution:
    """Make the line of the arm's repeatability, of the scatter of repeats."""
    return Contribution(
        name, formula, standard_mm, evaluation="A", degrees=degrees, of_arm=True
    )
