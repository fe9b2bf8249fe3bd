"""Numbers and words of displays: unit, system, uncertainty, deviation."""

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
GEOMETRY_UNKNOWN = "geometry unknown"
TIME_UNKNOWN = "time unknown"


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of length.

    Attributes:
        per_mm: number of units in a millimetre.
    """

    name: str
    per_mm: float
    digits: int

    def text(self, value_mm: float, *, sign: bool = False) -> str:
        value = value_mm * self.per_mm
        return f"{value:{'+' if sign else ''}z.{self.digits}f}"

    def with_name(self, value_mm: float) -> str:
        return f"{self.text(value_mm)} {self.name}"


MM = Unit("mm", 1.0, 3)
INCH = Unit("inch", 1.0 / 25.4, 5)


def place_mm(of: Live | Point, system: System) -> Vector | None:
    """Return the ball centre in a system; None if unknown."""
    return of.xyz_mm if system == "arm" else of.part_xyz_mm


def covariance_of(of: Live | Point) -> Covariance | None:
    """Return the covariance of the place; None without that of the arm's geometry.

    Otherwise only the smaller part, of the encoders, is published.
    """
    return None if is_geometry_unknown(of) else of.covariance_mm2


def is_geometry_unknown(of: Live | Point) -> bool:
    """Return whether the arm was never identified, so that its error is unknown."""
    return "geometry_unknown" in of.quality.flags


def expanded_axes_mm(of: Live | Point | None, system: System) -> list[float] | None:
    """Return the expanded uncertainty (k = 2) of each coordinate, or None.

    The directions of the part's axes are not published, so each of its coordinates has
    the uncertainty of the worst direction.
    """
    covariance_mm2 = None if of is None else covariance_of(of)
    if covariance_mm2 is None:
        return None
    xx, xy, xz, yy, yz, zz = covariance_mm2
    variances = np.array([xx, yy, zz])
    if system == "part":
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        variances = np.full(3, np.linalg.eigvalsh(matrix)[-1])
    expanded_mm = COVERAGE_FACTOR * np.sqrt(np.maximum(variances, 0.0))
    return [float(value) for value in expanded_mm]


def place_uncertainty(point: Point, unit: Unit) -> str:
    """Format the expanded uncertainty (k = 2) of the place, or why there is none."""
    if is_geometry_unknown(point):
        return GEOMETRY_UNKNOWN
    if point.covariance_mm2 is None:
        return TIME_UNKNOWN if "time_uncertain" in point.quality.flags else ""
    trace_mm2 = sum(point.covariance_mm2[i] for i in DIAGONAL)
    return unit.text(COVERAGE_FACTOR * float(np.sqrt(max(trace_mm2, 0.0))))


def label_words(point: Point) -> str:
    words = filter(None, (point.label.artefact, point.label.feature))
    return printable(" ".join(words))


def flag_words(of: Live | Point) -> str:
    return ", ".join(of.quality.flags).replace("_", " ")
