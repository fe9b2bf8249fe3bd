"""Recent trajectory of arm and ball: latest readings and poses.

Poses are computed on demand, so that storing a stream is cheap.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from operator import attrgetter

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.daemon.pose.poses import ArmReadings, LatchedPose, PoseBlock
from traverse.protocol.messages import QualityFlag

KEPT_NS = 3_000_000_000
READINGS_NS = 5_000_000_000  # an edge that waited for its board's clock is no older
SLOW_NS = 30_000_000  # interval for the decision whether the ball rests
SPEED_NS = 5_000_000  # over less the encoders' noise would be more than the speed
GAP_NS = 400_000_000  # an arm that reports its motion is asked every 250 ms at rest
NEAR_NS = 100_000_000  # between readings that confine a joint
KNOCK_RAD = 2e-3  # by which a touch swings it out of the way between them
SLACK_COUNTS = 4
INVALID_FLAGS = (QualityFlag.ENCODER_ERROR | QualityFlag.INCOMPLETE).value
"""Flags of samples without a valid ball position."""


class TrajectoryBuffer:
    """The last seconds of the stream."""

    def __init__(self) -> None:
        self._blocks: deque[PoseBlock] = deque()
        self._readings: deque[ArmReadings] = deque()

    def forget(self) -> None:
        self._blocks.clear()
        self._readings.clear()

    def follow(self, readings: ArmReadings) -> None:
        """Append readings without computing poses."""
        followed = self._readings
        followed.append(readings)
        oldest_ns = int(readings.samples.sample_time_ns[-1]) - READINGS_NS
        while followed[0].samples.sample_time_ns[-1] < oldest_ns:
            followed.popleft()

    def add(self, poses: PoseBlock) -> None:
        """Append a nonempty block."""
        blocks = self._blocks
        blocks.append(poses)
        oldest_ns = int(poses.sample_time_ns[-1]) - KEPT_NS
        while blocks[0].sample_time_ns[-1] < oldest_ns:
            blocks.popleft()

    @property
    def last_ns(self) -> int | None:
        return int(self._blocks[-1].sample_time_ns[-1]) if self._blocks else None

    def covers(self, time_ns: int) -> bool:
        """Return whether all samples until a time have arrived."""
        return bool(self._blocks) and self._blocks[-1].sample_time_ns[-1] >= time_ns

    def speeds_rad_s(self, time_ns: int, angles_rad: Floats) -> Floats | None:
        """Return joint speeds (n_joints,) at readings and a time.

        None without a valid sample.
        """
        for readings in reversed(self._readings):
            times_ns = readings.samples.sample_time_ns
            row = _last_until(times_ns, time_ns - SPEED_NS)
            if row < 0:
                continue
            elapsed_ns = time_ns - int(times_ns[row])
            if elapsed_ns > GAP_NS or readings.quality[row] & INVALID_FLAGS:
                return None
            passed_rad: Floats = angles_rad - readings.angles_rad[row]
            return passed_rad / (elapsed_ns * 1e-9)
        return None

    def denies(
        self,
        pose: LatchedPose,
        count_rad: Floats,
        *,
        bound_ns: int,
        ticks: int | None = None,
    ) -> bool:
        """Return whether the readings around an instant deny latched counts.

        Between two readings a joint is where it has been in them, or beside that by
        half of its way.

        Args:
            pose: of the latched counts.
            count_rad: of each joint, (n_joints,).
            bound_ns: how far the instant may be off.
            ticks: of the latch, by the counter of the readings, which leaves nothing
                open; None if they have none in common.
        """
        if ticks is None:
            at_ns = pose.sample_time_ns
            begin, end = at_ns - bound_ns, at_ns + bound_ns
            instants_of = attrgetter("samples.sample_time_ns")
        else:
            begin = end = ticks
            instants_of = attrgetter("samples.device_ticks")
        followed: list[ArmReadings] = []
        for readings in reversed(self._readings):
            followed.insert(0, readings)
            if instants_of(readings)[0] <= begin:
                break
        else:
            return False
        instants = np.concatenate([instants_of(readings) for readings in followed])
        first = int(np.searchsorted(instants, begin, side="right")) - 1
        last = int(np.searchsorted(instants, end))
        if last == len(instants):
            return False
        all_ns = np.concatenate([r.samples.sample_time_ns for r in followed])
        if all_ns[last] - all_ns[first] > NEAR_NS:
            return False
        around = slice(first, last + 1)
        quality = np.concatenate([r.quality for r in followed])[around]
        counts = np.concatenate([r.counts for r in followed])[around]
        low, high = counts.min(axis=0), counts.max(axis=0)
        slack = (high - low) / 2.0 + SLACK_COUNTS + KNOCK_RAD / count_rad
        is_beside = (pose.counts < low - slack) | (pose.counts > high + slack)
        return bool(is_beside.any() and not (quality & INVALID_FLAGS).any())

    def block_speeds_rad_s(self, readings: ArmReadings) -> Floats:
        """Return joint speeds (n, n_joints) at the latest readings; NaN if unknown."""
        times_ns = readings.samples.sample_time_ns
        before_ns = times_ns - SPEED_NS
        followed: list[ArmReadings] = []
        for earlier in reversed(self._readings):
            followed.insert(0, earlier)
            if earlier.samples.sample_time_ns[0] <= before_ns[0]:
                break
        all_ns = np.concatenate([r.samples.sample_time_ns for r in followed])
        rows = np.searchsorted(all_ns, before_ns, side="right") - 1
        elapsed_ns = times_ns - all_ns[rows]
        quality = np.concatenate([r.quality for r in followed])[rows]
        begin_rad = np.concatenate([r.angles_rad for r in followed])[rows]
        is_unknown = (rows < 0) | (elapsed_ns > GAP_NS) | (quality & INVALID_FLAGS > 0)
        seconds = np.where(is_unknown, np.nan, elapsed_ns * 1e-9)
        return np.asarray((readings.angles_rad - begin_rad) / seconds[:, np.newaxis])

    def speed_mm_s(self, time_ns: int) -> float | None:
        """Return the ball's net speed just before a time; None if unknown."""
        end = self._sample(time_ns)
        if end is None:
            return None
        block, row = end
        end_ns, end_mm = int(block.sample_time_ns[row]), block.xyz_mm[row]
        begin = self._sample(end_ns - SLOW_NS)
        if begin is None or time_ns - end_ns > GAP_NS:
            return None
        block, row = begin
        elapsed_ns = end_ns - int(block.sample_time_ns[row])
        away_mm = float(np.linalg.norm(end_mm - block.xyz_mm[row]))
        return None if elapsed_ns > GAP_NS else away_mm / (elapsed_ns * 1e-9)

    def position_mm(self, time_ns: int) -> Floats | None:
        """Return the ball's position (3,) at the last sample until a time."""
        sample = self._sample(time_ns)
        return None if sample is None else sample[0].xyz_mm[sample[1]]

    def _sample(self, time_ns: int) -> tuple[PoseBlock, int] | None:
        """Return block and row of the last sample until a time."""
        for block in reversed(self._blocks):
            row = _last_until(block.sample_time_ns, time_ns)
            if row >= 0:
                return block, row
        return None

    def last_position_beyond_mm(
        self, time_ns: int, from_mm: Floats, distance_mm: float
    ) -> Floats | None:
        """Return the last ball position (3,) before a time and beyond a distance."""
        for block in reversed(self._blocks):
            rows = np.flatnonzero(
                _away(block, from_mm, distance_mm) & (block.sample_time_ns < time_ns)
            )
            if len(rows):
                place: Floats = block.xyz_mm[rows[-1]]
                return place
        return None

    def between(self, time_ns: int, until_ns: int) -> Iterator[PoseBlock]:
        """Yield samples from one time to another, inclusive; no block is empty."""
        for block in self._blocks:
            times_ns = block.sample_time_ns
            if times_ns[-1] < time_ns or times_ns[0] > until_ns:
                continue
            first = int(np.searchsorted(times_ns, time_ns, side="left"))
            end = int(np.searchsorted(times_ns, until_ns, side="right"))
            if first < end:
                yield block.rows(slice(first, end))


def _last_until(times_ns: Integers, time_ns: int) -> int:
    """Return the row of the last sample until a time; -1 if there is none."""
    if times_ns[-1] <= time_ns:  # mostly: it is the latest
        return len(times_ns) - 1
    # Not NumPy's, which releases Python's lock: slower for so few.
    return bisect_right(times_ns, time_ns) - 1


def _away(block: PoseBlock, from_mm: Floats, distance_mm: float) -> Booleans:
    """Return which samples (n,) are valid and beyond a distance."""
    away = np.linalg.norm(block.xyz_mm - from_mm, axis=1) >= distance_mm
    return np.asarray(away & ((block.quality & INVALID_FLAGS) == 0))


def first_sample_beyond(
    block: PoseBlock, time_ns: int, from_mm: Floats, distance_mm: float
) -> tuple[int, Floats] | None:
    """Return time and position of the first sample after a time beyond a distance."""
    rows = np.flatnonzero(
        _away(block, from_mm, distance_mm) & (block.sample_time_ns > time_ns)
    )
    if not len(rows):
        return None
    return int(block.sample_time_ns[rows[0]]), block.xyz_mm[rows[0]]
