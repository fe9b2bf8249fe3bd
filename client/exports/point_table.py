"""Points as columns, and the interface of the files that hold them."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import IO, Literal, Self

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Integers
from traverse.protocol.messages import Point, Quality, QualityFlag, Scan

Coordinates = Literal["centre", "surface", "part"]

DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz
BITS = {flag.name.lower(): flag.value for flag in QualityFlag if flag.name}


WORDS = ("session", "scan", "id", "artefact", "feature", "flags")
"""Columns of a table that are texts."""


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """n points; `session` and `seq`, or `scan` and `seq`, are their key.

    Attributes:
        seq: numbers, (n,).
        time_ns: instants [UTC], (n,).
        xyz_mm: coordinates, (n, 3).
        ijk: the shank, (n, 3).
        std_mm: standard deviations of xyz_mm, (n, 3); NaN if unknown.
        quality: bits of the table of quality flags, (n,).
        ok: whether each is not in doubt, (n,).
        flags: names of the quality flags, with spaces between, (n,).
        covariance_mm2: of xyz_mm: xx, xy, xz, yy, yz, zz, (n, 6); NaN if unknown.
        time_bound_ns: how far time_ns may be off, (n,); NaN where not stated.
        session, scan, id, artefact, feature: texts, (n,); empty where there is none.
    """

    seq: Integers
    time_ns: Integers
    xyz_mm: Floats
    ijk: Floats
    std_mm: Floats
    quality: NDArray[np.uint32]
    ok: NDArray[np.bool_]
    flags: NDArray[np.str_]
    covariance_mm2: Floats
    time_bound_ns: Floats
    session: NDArray[np.str_]
    scan: NDArray[np.str_]
    id: NDArray[np.str_]
    artefact: NDArray[np.str_]
    feature: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.seq)


def scan_table(
    session: str,
    scan: str,
    *,
    seq: Integers,
    time_ns: Integers,
    xyz_mm: Floats,
    ijk: Floats,
    quality: NDArray[np.uint32],
    covariance_mm2: Floats | None,
) -> PointTable:
    """Points of a scan, which have neither label nor id."""
    n = len(seq)
    qualities = [Quality.from_bits(bits) for bits in quality.tolist()]
    none = np.full(n, "")
    if covariance_mm2 is None:
        covariance_mm2 = np.full((n, 6), np.nan)
    return PointTable(
        seq,
        time_ns,
        xyz_mm,
        ijk,
        np.sqrt(np.maximum(covariance_mm2[:, DIAGONAL], 0.0)),
        quality,
        np.array([point_quality.ok for point_quality in qualities], dtype=np.bool_),
        np.array(
            [" ".join(point_quality.flags) for point_quality in qualities],
            dtype=np.str_,
        ),
        covariance_mm2,
        np.full(n, np.nan),
        session=np.full(n, session),
        scan=np.full(n, scan),
        id=none,
        artefact=none,
        feature=none,
    )


def block_table(block: Scan, coordinates: Coordinates = "centre") -> PointTable | None:
    """Return a block of a scan as columns; None if it has no such coordinates."""
    places = {"centre": block.xyz_mm, "part": block.part_xyz_mm}
    xyz_mm = places.get(coordinates)
    if xyz_mm is None:
        return None
    return scan_table(
        block.session,
        block.scan,
        seq=np.arange(block.seq, block.seq + len(block.dtime_ns)),
        time_ns=block.time_ns + block.dtime_ns,
        xyz_mm=xyz_mm,
        ijk=block.ijk,
        quality=block.quality,
        covariance_mm2=block.covariance_mm2 if coordinates == "centre" else None,
    )


def standing(points: Sequence[Point]) -> list[Point]:
    retracted_ids = {point.retracts for point in points}
    return [p for p in points if p.retracts is None and p.id not in retracted_ids]


def table_of(points: Sequence[Point], coordinates: Coordinates) -> PointTable:
    """Return points as columns.

    Args:
        points: any number.
        coordinates: of the ball's centre, of the touched point, or of the centre in
            the part's system.

    Raises:
        ValueError: a point has no such coordinates.
    """
    places = [place_of(point, coordinates) for point in points]
    n = len(points)
    covariance_mm2 = np.full((n, 6), np.nan)
    for row, point in enumerate(points):
        # What a correction for the ball adds is not stated: the centre's is. Part
        # coordinates have none: it is of the arm's system.
        if point.covariance_mm2 is not None and coordinates != "part":
            covariance_mm2[row] = point.covariance_mm2
    return PointTable(
        np.array([p.seq for p in points], dtype=np.int64),
        np.array([p.time_ns for p in points], dtype=np.int64),
        np.array(places, dtype=np.float64).reshape(n, 3),
        np.array([p.ijk for p in points], dtype=np.float64).reshape(n, 3),
        np.sqrt(np.maximum(covariance_mm2[:, DIAGONAL], 0.0)),
        np.array([_bits(p) for p in points], dtype=np.uint32),
        np.array([p.quality.ok for p in points], dtype=np.bool_),
        _texts(" ".join(p.quality.flags) for p in points),
        covariance_mm2,
        np.array([p.time_bound_ns for p in points], dtype=np.float64),
        session=_texts(p.session for p in points),
        scan=np.full(n, ""),
        id=_texts(p.id for p in points),
        artefact=_texts(p.label.artefact for p in points),
        feature=_texts(p.label.feature for p in points),
    )


def place_of(point: Point, coordinates: Coordinates) -> tuple[float, float, float]:
    """Return the chosen coordinates of a point [mm].

    Raises:
        ValueError: it has none of these.
    """
    if coordinates == "centre":
        return point.xyz_mm
    place = point.surface_mm if coordinates == "surface" else point.part_xyz_mm
    if place is None:
        lacks = {
            "surface": "was taken without compensation, so it has no touched point",
            "part": "was taken without an alignment, so it has no part coordinates; "
            "align the arm before you measure, or export the ball's centre",
        }[coordinates]
        raise ValueError(f"point {point.seq} of session {point.session} {lacks}")
    return place


def _texts(values: Iterable[str | None]) -> NDArray[np.str_]:
    return np.array([value or "" for value in values], dtype=np.str_)


def _bits(point: Point) -> int:
    """Return bits of the flags; unknown flags only if they are numbers."""
    return sum(_bit(name) for name in set(point.quality.flags))


def _bit(name: str) -> int:
    if name in BITS:
        return BITS[name]
    number = name.removeprefix("bit_")
    is_bit = name != number and number.isdecimal() and int(number) < 32
    return 1 << int(number) if is_bit else 0


class Sink(ABC):
    """Writes points or tables of scans to a binary file, piece by piece.

    Attributes:
        in_doubt: number of those in doubt.
        lacks: properties that the format cannot carry, for people; may be empty.
    """

    lacks: str = ""

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        self._file = file
        self._coordinates = coordinates
        self.n = 0
        self.in_doubt = 0

    def points(self, points: Sequence[Point]) -> None:
        """Write points.

        Raises:
            ValueError: they lack something that the format requires.
        """
        self.table(table_of(points, self._coordinates))

    def _check(self, points: Sequence[Point]) -> None:
        """Check that all have the chosen coordinates, and count those in doubt.

        Raises:
            ValueError: one has none.
        """
        for point in points:
            place_of(point, self._coordinates)
            self.in_doubt += not point.quality.ok

    def _count(self, table: PointTable) -> None:
        self.n += len(table)
        self.in_doubt += int(np.count_nonzero(~table.ok))

    @abstractmethod
    def table(self, table: PointTable) -> None:
        """Write rows of a scan."""

    def end(self) -> None:  # noqa: B027 - most formats need no end
        """Write the trailer, or the header."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if error is None:
            self.end()
