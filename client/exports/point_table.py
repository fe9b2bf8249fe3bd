"""Points as columns, and the interface of the files that hold them."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO, Literal, Self

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Integers
from traverse.protocol.messages import Point, QualityFlag

Coordinates = Literal["centre", "surface", "part"]

DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz
BITS = {flag.name.lower(): flag.value for flag in QualityFlag if flag.name}


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """n points.

    Attributes:
        seq: numbers, (n,).
        time_ns: instants [UTC], (n,).
        xyz_mm: coordinates, (n, 3).
        ijk: the shank, (n, 3).
        std_mm: standard deviations of xyz_mm, (n, 3); NaN if unknown.
        quality: bits of the table of quality flags, (n,).
    """

    seq: Integers
    time_ns: Integers
    xyz_mm: Floats
    ijk: Floats
    std_mm: Floats
    quality: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.seq)


def standing(points: Sequence[Point]) -> list[Point]:
    """Points that are not retracted, without the retractions."""
    gone = {point.retracts for point in points}
    return [p for p in points if p.retracts is None and p.id not in gone]


def table_of(points: Sequence[Point], coordinates: Coordinates) -> PointTable:
    """Points as columns.

    Args:
        points: any number.
        coordinates: of the ball's centre, of the touched point, or of the centre in
            the part's system.

    Raises:
        ValueError: a point has no such coordinates.
    """
    places = [place_of(point, coordinates) for point in points]
    n = len(points)
    std_mm = np.full((n, 3), np.nan)
    for row, point in enumerate(points):
        # What a correction for the ball adds is not stated: the centre's is.
        if point.covariance_mm2 is not None and coordinates != "part":
            variances = [max(point.covariance_mm2[i], 0.0) for i in DIAGONAL]
            std_mm[row] = np.sqrt(variances)
    return PointTable(
        np.array([p.seq for p in points], dtype=np.int64),
        np.array([p.time_ns for p in points], dtype=np.int64),
        np.array(places, dtype=np.float64).reshape(n, 3),
        np.array([p.ijk for p in points], dtype=np.float64).reshape(n, 3),
        std_mm,
        np.array([_bits(p) for p in points], dtype=np.uint32),
    )


def place_of(point: Point, coordinates: Coordinates) -> tuple[float, float, float]:
    """The chosen coordinates of a point [mm].

    Raises:
        ValueError: it has none of these.
    """
    if coordinates == "centre":
        return point.xyz_mm
    place = point.surface_mm if coordinates == "surface" else point.part_xyz_mm
    if place is None:
        lacks = {
            "surface": "was taken without compensation, so it has no touched point",
            "part": "was taken without an alignment, so it has no part coordinates",
        }[coordinates]
        raise ValueError(f"point {point.seq} of session {point.session} {lacks}")
    return place


def _bits(point: Point) -> int:
    return sum(BITS.get(name, 0) for name in point.quality.flags)


class Sink(ABC):
    """Writes points or tables of scans to a binary file, piece by piece.

    Args:
        file: open for writing, seekable.
        coordinates: which ones of points.
    """

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        self._file = file
        self._coordinates = coordinates
        self.n = 0

    def points(self, points: Sequence[Point]) -> None:
        """Write points.

        Raises:
            ValueError: they lack what the format requires.
        """
        self.table(table_of(points, self._coordinates))

    @abstractmethod
    def table(self, table: PointTable) -> None:
        """Write rows of a scan."""

    def end(self) -> None:  # noqa: B027 - most formats need no end
        """Write the trailer, or the header when the end is known."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if error is None:
            self.end()
