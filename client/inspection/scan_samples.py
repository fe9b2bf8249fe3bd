"""Samples of a scan as touches of a feature, thinned evenly in space.

Of the samples in each cube of a grid the first one is kept. When there are too many,
the cubes grow.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.client.inspection.values import ScanPart
from traverse.protocol.messages import Label, Point, Quality, Scan
from traverse.protocol.messages.scan import Bits

MOST_SAMPLES = 200
_FIRST_SPACING_MM = 0.05
_GROWTH = 2.0**0.5


class Sample(Point):
    """A sample of a scan that counts as a touch; its number in the scan is `seq`."""

    part: ScanPart
    """Of which it was chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """Samples that follow each other.

    Attributes:
        seq: numbers in the scan, (n,).
        time_ns: [UTC], (n,).
        part_xyz_mm: None without an alignment.
        covariance_mm2: xx, xy, xz, yy, yz, zz, (n, 6); NaN where unknown.
        quality: bits of the table of flags, (n,).
    """

    session: str
    scan: str
    arm: str
    model: str
    probe_radius_mm: float
    seq: Integers
    time_ns: Integers
    xyz_mm: Floats
    ijk: Floats
    angles_rad: Floats
    part_xyz_mm: Floats | None
    covariance_mm2: Floats
    quality: Bits


def block_of(scan: Scan) -> SampleBlock:
    n = len(scan.dtime_ns)
    covariance_mm2 = scan.covariance_mm2
    return SampleBlock(
        scan.session,
        scan.scan,
        scan.arm,
        scan.model,
        scan.probe_radius_mm,
        np.arange(scan.seq, scan.seq + n),
        scan.time_ns + scan.dtime_ns,
        scan.xyz_mm,
        scan.ijk,
        scan.angles_rad,
        scan.part_xyz_mm,
        np.full((n, 6), np.nan) if covariance_mm2 is None else covariance_mm2,
        scan.quality,
    )


class ThinnedScan:
    """Keeps some samples of one scan, from all over the place that it was at.

    Attributes:
        part: what came so far.
    """

    def __init__(self, session: str, scan: str) -> None:
        self.part = ScanPart(session, scan)
        self._next: int | None = None
        self._spacing_mm = _FIRST_SPACING_MM
        self._kept: dict[tuple[int, ...], tuple[SampleBlock, int]] = {}

    def add(self, block: SampleBlock) -> None:
        """Take the samples that follow."""
        n = len(block.seq)
        if n == 0:
            return
        first, part = int(block.seq[0]), self.part
        doubts = [not Quality.from_bits(bits).ok for bits in block.quality.tolist()]
        lost = 0 if self._next is None else first - self._next
        self._next = int(block.seq[-1]) + 1
        for row, cube in enumerate(self._cubes(block.xyz_mm)):
            self._kept.setdefault(cube, (block, row))
        while len(self._kept) > MOST_SAMPLES:
            self._spacing_mm *= _GROWTH
            kept, self._kept = [*self._kept.values()], {}
            places_mm = np.array([block.xyz_mm[row] for block, row in kept])
            for cube, sample in zip(self._cubes(places_mm), kept, strict=True):
                self._kept.setdefault(cube, sample)
        self.part = replace(
            part,
            used=len(self._kept),
            samples=part.samples + n,
            lost=part.lost + lost,
            in_doubt=part.in_doubt + sum(doubts),
        )

    def samples(self) -> list[Sample]:
        """Return the kept ones, in their order."""
        return [self._sample(block, row) for block, row in self._kept.values()]

    def _cubes(self, places_mm: Floats) -> list[tuple[int, ...]]:
        cubes = np.floor(places_mm / self._spacing_mm).astype(np.int64)
        return [tuple(cube) for cube in cubes.tolist()]

    def _sample(self, block: SampleBlock, row: int) -> Sample:
        seq, angles_rad = int(block.seq[row]), block.angles_rad[row].tolist()
        covariance_mm2, part_xyz_mm = block.covariance_mm2[row], block.part_xyz_mm
        is_known = not np.isnan(covariance_mm2).any()
        return Sample(
            session=block.session,
            seq=seq,
            id=f"{block.session}-{block.scan}-{seq}",
            retracts=None,
            arm=block.arm,
            model=block.model,
            trigger="timer",
            time_ns=int(block.time_ns[row]),
            xyz_mm=tuple(block.xyz_mm[row].tolist()),
            ijk=tuple(block.ijk[row].tolist()),
            surface_mm=None,
            compensation="none",
            part_xyz_mm=(
                None if part_xyz_mm is None else tuple(part_xyz_mm[row].tolist())
            ),
            covariance_mm2=tuple(covariance_mm2.tolist()) if is_known else None,
            angles_rad=tuple(angles_rad),
            counts=(0,) * len(angles_rad),  # a scan may leave them out
            temperature_c=None,
            probe_radius_mm=block.probe_radius_mm,
            samples=1,
            spread_mm=None,
            label=Label(),
            quality=Quality.from_bits(int(block.quality[row])),
            part=self.part,
        )


def scan_parts(points: Sequence[Point]) -> Iterator[ScanPart]:
    """Return the scans that some points are samples of; parts of one are joined."""
    every = [point.part for point in points if isinstance(point, Sample)]
    for scan in dict.fromkeys(part.scan for part in every):
        of_samples = [part for part in every if part.scan == scan]
        parts = set(of_samples)
        yield replace(
            of_samples[0],
            used=len(of_samples),
            samples=sum(part.samples for part in parts),
            lost=sum(part.lost for part in parts),
            in_doubt=sum(part.in_doubt for part in parts),
        )
