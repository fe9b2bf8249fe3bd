"""Comparison of recorded points and scans with those of a replay."""

from collections import Counter, defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Indices
from traverse.protocol.messages import Point, Scan

ULPS = 4
LENGTHS = ("xyz_mm", "surface_mm", "part_xyz_mm")
EXACT = ("counts", "compensation", "samples", "temperature_c", "probe_radius_mm")
COMPUTED = ("ijk", "angles_rad", "covariance_mm2", "spread_mm")
Key = tuple[int, ...]
RELATIVE = 1e-9  # of covariances and spreads, with another kernel


@dataclass(slots=True)
class Tally:
    """Comparison of points of one kind.

    Attributes:
        same: equal to the last bit.
        within: within the tolerance for another kernel.
        largest_mm: greatest difference of a coordinate.
    """

    n: int = 0
    same: int = 0
    within: int = 0
    largest_mm: float = 0.0
    differing: Counter[str] = field(default_factory=Counter)


@dataclass(eq=False)
class PointComparison:
    """Matches points by their instants.

    Attributes:
        is_recut: blocks are cut differently; see `excused`.
        tolerance_mm: for another kernel, some ulp of the arm's reach.
        sure: points that do not depend on the time before the recording.
        early: points of the first seconds of a recording that began in the middle.
        not_kept: points that the disk refused.
        excused: interpolated points whose covariance or skew flag differs for the
            cut: error bounds use one more reading where it has already arrived.
    """

    is_recut: bool = False
    tolerance_mm: float = 0.0

    def __post_init__(self) -> None:
        self.excused = self.not_kept = 0
        self.sure, self.early = Tally(), Tally()
        self._then: dict[Key, list[Point]] = defaultdict(list)
        self._now: dict[Key, list[tuple[Point, bool]]] = defaultdict(list)

    def was(self, point: Point) -> None:
        self._then[_key(point)].append(point)
        self._match(_key(point))

    def is_now(self, point: Point, *, early: bool) -> None:
        self._now[_key(point)].append((point, early))
        self._match(_key(point))

    @property
    def missing(self) -> int:
        """Recorded points that the replay does not reproduce."""
        return sum(map(len, self._then.values()))

    @property
    def new(self) -> int:
        return sum(map(len, self._now.values()))

    def _match(self, key: Key) -> None:
        if not self._then[key] or not self._now[key]:
            return
        then = self._then[key].pop(0)
        now, early = self._now[key].pop(0)
        for table in (self._then, self._now):
            if not table[key]:
                del table[key]
        self._compare(then, now, self.early if early else self.sure)

    def _compare(self, then: Point, now: Point, tally: Tally) -> None:
        differing = [
            name
            for name in (*EXACT, *COMPUTED, *LENGTHS)
            if getattr(then, name) != getattr(now, name)
        ]
        if then.quality != now.quality:
            differing.append("quality")
        if self.is_recut and differing and "interpolated" in then.quality.flags:
            kept = [name for name in differing if name not in ("covariance_mm2",)]
            if set(then.quality.flags) ^ set(now.quality.flags) <= {"skew"}:
                kept = [name for name in kept if name != "quality"]
            self.excused += len(kept) < len(differing)
            differing = kept
        far_mm = 0.0
        close = not set(differing) & {*EXACT, "quality"}
        for name in set(differing) & set(LENGTHS):
            recorded, other = getattr(then, name), getattr(now, name)
            if recorded is None or other is None:
                close = False
            else:
                far_mm = max(far_mm, float(np.abs(np.subtract(recorded, other)).max()))
        for name in set(differing) & set(COMPUTED):
            close = close and _is_close(getattr(then, name), getattr(now, name), name)
        tally.n += 1
        tally.same += not differing
        tally.within += close and far_mm <= self.tolerance_mm
        tally.largest_mm = max(tally.largest_mm, far_mm)
        tally.differing.update(differing)


class ScanComparison:
    """Matches points of scans by scan and number.

    Attributes:
        then, now: recorded clouds, and messages of the replay, by scan.
        begun: scans recorded from their beginning.
        left_out: points of other scans.
        missing: recorded points that the replay does not reproduce.
    """

    def __init__(self) -> None:
        self.tally = Tally()
        self.then: dict[str, list[NDArray[np.void]]] = defaultdict(list)
        self.now: dict[str, list[Scan]] = defaultdict(list)
        self.begun: set[str] = set()
        self.left_out = self.missing = 0

    def settle(self, tolerance_mm: float) -> None:
        for name, clouds in self.then.items():
            then = np.concatenate(clouds)
            if name not in self.begun:
                self.left_out += len(then)
                continue
            now = self.now.get(name, [])
            numbers = [np.arange(s.seq, s.seq + len(s.xyz_mm)) for s in now]
            if not sum(map(len, numbers)):
                self.missing += len(then)
                continue
            all_numbers = np.concatenate(numbers)
            rows = np.searchsorted(all_numbers, then["number"])
            rows_in = np.minimum(rows, len(all_numbers) - 1)
            is_there = all_numbers[rows_in] == then["number"]
            self.missing += int((~is_there).sum())
            rows = rows_in[is_there]
            self._compare(then[is_there], now, rows, tolerance_mm)

    def _compare(
        self, then: NDArray[np.void], now: list[Scan], rows: Indices, limit_mm: float
    ) -> None:
        xyz_mm = np.concatenate([s.xyz_mm for s in now])[rows]
        ijk = np.concatenate([s.ijk for s in now])[rows]
        quality = np.concatenate([s.quality for s in now])[rows]
        then_mm = np.column_stack([then[f"{axis}_mm"] for axis in "xyz"])
        far_mm = np.abs(then_mm - xyz_mm).max(axis=1, initial=0.0)
        then_ijk = np.column_stack([then[axis] for axis in "ijk"])
        turned = np.abs(then_ijk - ijk).max(axis=1, initial=0.0)
        flagged = then["quality"] != quality
        tally = self.tally
        same = (far_mm == 0.0) & (turned == 0.0) & ~flagged
        tally.n += len(then)
        tally.same += int(same.sum())
        is_within = (far_mm <= limit_mm) & (turned <= ULPS * 2.3e-16)
        tally.within += int((is_within & ~flagged).sum())
        tally.largest_mm = max(tally.largest_mm, float(far_mm.max(initial=0.0)))
        differing = {"xyz_mm": far_mm, "ijk": turned, "quality": flagged}
        for name, differs in differing.items():
            tally.differing[name] += int(np.count_nonzero(differs))
        tally.differing = +tally.differing


def _key(point: Point) -> Key:
    """Return what identifies a point in both; an undo is executed in its turn."""
    if point.retracts is not None:
        return point.counts
    return (point.time_ns,)


Numbers = float | tuple[float, ...] | None


def _is_close(first: Numbers, other: Numbers, name: str) -> bool:
    if first is None or other is None:
        return False
    then, now = np.atleast_1d(first), np.atleast_1d(other)
    if then.shape != now.shape:
        return False
    if name in ("covariance_mm2", "spread_mm"):
        scale = float(np.abs(then).max())
        return bool(np.abs(then - now).max() <= RELATIVE * scale + 1e-12)
    return bool(
        np.abs(then - now).max() <= ULPS * 2.3e-16 * max(1.0, np.abs(then).max())
    )


@dataclass(slots=True)
class ReplayResult:
    """Results of a replay.

    Attributes:
        kernel_then, kernel_now: that computed the results.
        samples: replayed sets of counts.
        gaps: how often something is missing in the recording.
        tear: where the file is torn, or None.
    """

    points: PointComparison
    scans: ScanComparison
    kernel_then: str
    kernel_now: str
    samples: int = 0
    gaps: int = 0
    tear: str | None = None

    @property
    def holds(self) -> bool:
        """Whether results are equal, or with another kernel within the tolerance."""
        tally_name = "same" if self.kernel_then == self.kernel_now else "within"
        tallies = (self.points.sure, self.scans.tally)
        agree = all(getattr(tally, tally_name) == tally.n for tally in tallies)
        return agree and not self.points.missing and not self.scans.missing
