"""The uncertainty of a test value: what the standard adds, not what the arm does.

The arm's own errors, its repeatability included, are what is tested, so they are no
part of it. What remains are the standard's certificate, its temperature, its expansion,
its form, and how firmly it stood (in the manner of ISO/TS 23165 [K]).
"""

from dataclasses import dataclass

import numpy as np

from traverse.lab.acceptance.conformity.limits import Standards


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of a budget.

    Attributes:
        name: What it comes from.
        formula: With the numbers in it.
        standard_mm: Standard uncertainty of the test value from it.
    """

    name: str
    formula: str
    standard_mm: float


@dataclass(frozen=True, slots=True)
class Budget:
    """The standard uncertainty of a test value, line by line."""

    lines: tuple[Contribution, ...]

    @property
    def standard_mm(self) -> float:
        """Root of the sum of squares."""
        return float(np.sqrt(sum(line.standard_mm**2 for line in self.lines)))


def length_budget(
    length_mm: float,
    calibration_mm: float,
    standards: Standards,
    per_c: float,
    warmer_c: float,
) -> Budget:
    """Draw up the budget of a length, which may be a diameter.

    Args:
        length_mm: Certified.
        calibration_mm: Standard uncertainty of that.
        standards: What else is known.
        per_c: Coefficient of expansion.
        warmer_c: Temperature less that of the certificate.
    """
    expansion_mm = length_mm * standards.expansion_std_per_c * abs(warmer_c)
    temperature_mm = length_mm * abs(per_c) * standards.temperature_std_c
    return Budget(
        (
            Contribution("calibration", "of the certificate", calibration_mm),
            Contribution(
                "expansion coefficient",
                f"{length_mm:g} mm x {standards.expansion_std_per_c:g} /C x "
                f"{abs(warmer_c):.2f} C",
                expansion_mm,
            ),
            Contribution(
                "temperature",
                f"{length_mm:g} mm x {per_c:g} /C x {standards.temperature_std_c:g} C",
                temperature_mm,
            ),
            Contribution("fixture", "as stated", standards.fixture_std_mm),
        )
    )


def form_budget(standards: Standards) -> Budget:
    """Draw up the budget of what the form of a test sphere disturbs."""
    return Budget(
        (
            Contribution(
                "form of the sphere",
                f"{standards.form_mm:g} mm / 2",
                standards.form_mm / 2.0,
            ),
            Contribution("its uncertainty", "as stated", standards.form_std_mm),
            Contribution("fixture", "as stated", standards.fixture_std_mm),
        )
    )


def fixture_budget(standards: Standards) -> Budget:
    """Draw up the budget of a test that needs no calibrated standard."""
    return Budget((Contribution("fixture", "as stated", standards.fixture_std_mm),))
