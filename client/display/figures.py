"""Numbers and words as displays show them: unit, system, uncertainty, deviation."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.protocol.messages import Live, Point
from traverse.protocol.messages.fields import Vector
from traverse.protocol.messages.point import Covariance
from traverse.protocol.printable import printable

System = Literal["arm", "part"]
SYSTEMS: dict[System, str] = {"arm": "arm's system", "part": "part's system"}
DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz
COVERAGE_FACTOR = 2.0


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of length.

    Attributes:
        per_mm: so many of it are a millimetre.
        digits: decimals shown.
    """

    name: str
    per_mm: float
    digits: int

    def text(self, value_mm: float, *, sign: bool = False) -> str:
        """A length without its unit; what is rounded to zero has no minus."""
        value = value_mm * self.per_mm
        return f"{value:{'+' if sign else ''}z.{self.digits}f}"

    def with_name(self, value_mm: float) -> str:
        """A length with its unit."""
        return f"{self.text(value_mm)} {self.name}"


MM = Unit("mm", 1.0, 3)
INCH = Unit("inch", 1.0 / 25.4, 5)


def place_mm(of: Live | Point, system: System) -> Vector | None:
    """Ball centre in a system; None if unknown there."""
    return of.xyz_mm if system == "arm" else of.part_xyz_mm


def expanded_axes_mm(
    covariance_mm2: Covariance | None, system: System
) -> list[float] | None:
    """Expanded uncertainty (k = 2) of each coordinate.

    How the part's axes lie in the arm's is not published, so there each coordinate has
    that of the worst direction.
    """
    if covariance_mm2 is None:
        return None
    xx, xy, xz, yy, yz, zz = covariance_mm2
    variances = np.array([xx, yy, zz])
    if system == "part":
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        variances = np.full(3, np.linalg.eigvalsh(matrix)[-1])
    expanded_mm = COVERAGE_FACTOR * np.sqrt(np.maximum(variances, 0.0))
    return [float(value) for value in expanded_mm]


def expanded_place_mm(covariance_mm2: Covariance | None) -> float | None:
    """Expanded uncertainty (k = 2) of the place as a whole."""
    if covariance_mm2 is None:
        return None
    trace_mm2 = sum(covariance_mm2[i] for i in DIAGONAL)
    return COVERAGE_FACTOR * float(np.sqrt(max(trace_mm2, 0.0)))


def label_words(point: Point) -> str:
    """Artefact and feature of a point."""
    words = filter(None, (point.label.artefact, point.label.feature))
    return printable(" ".join(words))


def flag_words(of: Live | Point) -> str:
    """Its quality flags."""
    return ", ".join(of.quality.flags).replace("_", " ")
