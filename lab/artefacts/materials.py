"""Coefficients of thermal expansion of the usual materials of standards, near 20 C.

Steel is that of gauge blocks, (11.5 +- 1.0) 1e-6/C by ISO 3650; the others are general
knowledge. Where the standard's certificate states a coefficient, that is better. The
standard uncertainties are of an even distribution within the limits of the table.
ISO 3650 states its coefficient from 10 to 30 C (general knowledge): there the table
holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Literal

MaterialName = Literal[
    "steel",
    "stainless-steel",
    "aluminium",
    "tungsten-carbide",
    "zirconia",
    "alumina",
    "silicon-nitride",
    "invar",
    "carbon-fibre",
    "glass-ceramic",
    "fused-silica",
    "granite",
]


TABLE_HOLDS_C = (10.0, 30.0)


@dataclass(frozen=True, slots=True)
class Expansion:
    """Coefficient of thermal expansion; None where it is not stated.

    Attributes:
        per_c: Relative growth per degree Celsius.
        std_per_c: Its standard uncertainty.
    """

    per_c: float | None
    std_per_c: float | None


def _within(middle_ppm: float, limit_ppm: float) -> Expansion:
    return Expansion(1e-6 * middle_ppm, 1e-6 * limit_ppm / sqrt(3.0))


MATERIALS: Mapping[MaterialName, Expansion] = {
    "steel": _within(11.5, 1.0),
    "stainless-steel": _within(16.5, 1.5),
    "aluminium": _within(23.3, 1.2),
    "tungsten-carbide": _within(4.5, 0.8),
    "zirconia": _within(9.7, 1.0),
    "alumina": _within(6.0, 1.5),
    "silicon-nitride": _within(3.2, 0.5),
    "invar": _within(1.3, 0.7),
    "carbon-fibre": _within(0.5, 1.5),
    "glass-ceramic": _within(0.0, 0.1),
    "fused-silica": _within(0.5, 0.1),
    "granite": _within(6.5, 2.0),
}
