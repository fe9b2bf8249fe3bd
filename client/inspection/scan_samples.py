"""Samples of a scan as touches of a feature, thinned evenly in space.

Of the samples in each cube of a grid the first one is kept. When there are too many,
the cubes grow.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from traverse.arrays import Floats
from traverse.client.inspection.values import ScanPart
from traverse.protocol.messages import Label, Point, Quality, Scan

MOST_SAMPLES = 200
_FIRST_SPACING_MM = 0.05
_GROWTH = 2.0**0.5


class Sample(Point):
    """A sample of a scan that counts as a touch; its number in the scan is `seq`."""

    part: ScanPart
    """Of which it was chosen."""


class ThinnedScan:
    """Keeps some samples of one scan, from all over the place that it was at.

    Attributes:
        part: what came so far.
    """

    def __init__(self, session: str, scan: str) -> None:
        self.part = ScanPart(session, scan)
        self._next: int | None = None
        self._spacing_mm = _FIRST_SPACING_MM
        self._kept: dict[tuple[float, ...], tuple[Scan, int]] = {}

    def add(self, scan: Scan, numbers: tuple[float, float] = (0, math.inf)) -> None:
        """Take the samples that follow, as far as their numbers are between two."""
        n, (least, most) = len(scan.dtime_ns), numbers
        rows = [row for row in range(n) if least <= scan.seq + row <= most]
        if not rows:
            return
        first, part = scan.seq + rows[0], self.part
        bits = scan.quality[rows].tolist()
        doubts = [not Quality.from_bits(of_sample).ok for of_sample in bits]
        lost = 0 if self._next is None else first - self._next
        self._next = first + len(rows)
        for row, cube in zip(rows, self._cubes(scan.xyz_mm[rows]), strict=True):
            self._kept.setdefault(cube, (scan, row))
        while len(self._kept) > MOST_SAMPLES:
            self._spacing_mm *= _GROWTH
            kept, self._kept = [*self._kept.values()], {}
            places_mm = np.array([of.xyz_mm[row] for of, row in kept])
            for cube, sample in zip(self._cubes(places_mm), kept, strict=True):
                self._kept.setdefault(cube, sample)
        self.part = replace(
            part,
            used=len(self._kept),
            samples=part.samples + len(rows),
            lost=part.lost + lost,
            in_doubt=part.in_doubt + sum(doubts),
        )

    def samples(self) -> list[Sample]:
        """Return the kept ones, in their order."""
        return [self._sample(scan, row) for scan, row in self._kept.values()]

    def _cubes(self, places_mm: Floats) -> list[tuple[float, ...]]:
        return [*map(tuple, np.floor(places_mm / self._spacing_mm).tolist())]

    def _sample(self, scan: Scan, row: int) -> Sample:
        def vector(name: str) -> tuple[float, ...] | None:
            array = getattr(scan, name)
            return None if array is None else tuple(array[row].tolist())

        seq = scan.seq + row
        angles_rad = vector("angles_rad") or ()
        return Sample.model_validate(
            {
                "session": scan.session,
                "seq": seq,
                "id": f"{scan.scan[:40]}-{seq}",
                "retracts": None,
                "arm": scan.arm,
                "model": scan.model,
                "trigger": "timer",
                "time_ns": scan.time_ns + int(scan.dtime_ns[row]),
                "xyz_mm": vector("xyz_mm"),
                "ijk": vector("ijk"),
                "surface_mm": None,
                "compensation": "none",
                "part_xyz_mm": vector("part_xyz_mm"),
                "covariance_mm2": vector("covariance_mm2"),
                "angles_rad": angles_rad,
                "counts": (0,) * len(angles_rad),  # a scan may leave them out
                "temperature_c": None,
                "probe_radius_mm": scan.probe_radius_mm,
                "samples": 1,
                "spread_mm": None,
                "label": Label(),
                "quality": Quality.from_bits(int(scan.quality[row])),
                "part": self.part,
            }
        )


def scan_parts(points: Sequence[Point]) -> Iterator[ScanPart]:
    """Return the scans that some points are samples of; parts of one are joined."""
    every = [point.part for point in points if isinstance(point, Sample)]
    for scan in dict.fromkeys(part.scan for part in every):
        of_samples = [part for part in every if part.scan == scan]
        doubtful = [p for p in points if isinstance(p, Sample) and not p.quality.ok]
        parts = set(of_samples)
        yield replace(
            of_samples[0],
            used=len(of_samples),
            samples=sum(part.samples for part in parts),
            lost=sum(part.lost for part in parts),
            # Of those that were not chosen it is not known what came later.
            in_doubt=max(
                sum(part.in_doubt for part in parts),
                sum(sample.part.scan == scan for sample in doubtful),
            ),
        )
