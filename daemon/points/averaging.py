"""A point that is the mean of many samples, taken while the arm rests.

Sums are of distances from the first sample, so that a minute at 10 kHz needs no more
memory than a moment. The speed is the slope of the best straight line through all
samples; a tremble about one place has no speed, but a spread.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.kinematics.effects.base.block import Block
from traverse.plurals import counted
from traverse.protocol.messages import QualityFlag

MAX_AVERAGING_NS = 60_000_000_000
SPEED_NS = 20_000_000  # over less, noise would be taken for a speed
_COLUMNS = 12  # sums beside those of the angles
UNUSABLE_FLAGS = (
    QualityFlag.ENCODER_ERROR
    | QualityFlag.LATE
    | QualityFlag.STALE
    | QualityFlag.INCOMPLETE
)
"""Flags of samples that must not go into a mean."""


@dataclass(frozen=True, slots=True)
class AverageLimits:
    """Limits within which the arm is at rest.

    Attributes:
        speed_mm_s: speed of the ball.
        spread_mm: root mean square distance of the samples from their mean.
    """

    speed_mm_s: float
    spread_mm: float


class SampleAverage:
    """Collect samples of a stream from one instant on.

    Args:
        begin_ns: host monotonic; earlier samples do not count.
        samples: how many; None: all within ``dwell_ns``.
        dwell_ns: for how long; None: as long as ``samples`` take.

    Attributes:
        n: number of samples so far.
        last_ns: time of the last; ``begin_ns`` before the first.
        time_bound_ns: how far the time of any of them may be off.
        is_complete: no further sample is needed.
        is_mixed: some samples are from before a change of probe.
        begin_speed_mm_s: speed of the ball at the beginning; None: not known.
        before_mm: earlier place of the probe, (3,).
    """

    def __init__(
        self,
        begin_ns: int,
        samples: int | None,
        dwell_ns: int | None,
        limits: AverageLimits,
    ) -> None:
        self._begin_ns = self.last_ns = begin_ns
        self._samples, self._limits = samples, limits
        self._end_ns = None if dwell_ns is None else begin_ns + dwell_ns
        self.begin_speed_mm_s: float | None = None
        self.is_mixed = False
        self.before_mm: Floats | None = None
        self.n = self.time_bound_ns = 0
        self.is_complete = False
        self._quality = 0
        # Of times in s and distances in mm from the first sample.
        self._times_s = self._squares_s2 = self._squares_mm2 = 0.0
        self._moments_mm_s = np.zeros(3)

    def add(self, poses: PoseBlock) -> None:
        if self.is_complete:
            return
        times_ns = poses.sample_time_ns
        rows = times_ns > self.last_ns if self.n else times_ns >= self._begin_ns
        if self._end_ns is not None:
            self.is_complete = bool(times_ns[-1] >= self._end_ns)
            rows &= times_ns <= self._end_ns
        needed_rows = np.flatnonzero(rows)
        if self._samples is not None:
            needed_rows = needed_rows[: self._samples - self.n]
            self.is_complete = self.n + len(needed_rows) == self._samples
        if len(needed_rows):
            self._sum(poses.rows(slice(int(needed_rows[0]), int(needed_rows[-1]) + 1)))

    def _sum(self, poses: PoseBlock) -> None:
        if self.n == 0:
            self._first = poses.rows(slice(0, 1))
            self._sums = np.zeros(_COLUMNS + poses.angles_rad.shape[1])
        first = self._first
        away_mm = poses.xyz_mm - first.xyz_mm
        elapsed_s = (poses.sample_time_ns - first.sample_time_ns) * 1e-9
        squares_mm2 = away_mm[:, 0] ** 2 + away_mm[:, 1] ** 2 + away_mm[:, 2] ** 2
        columns = (
            elapsed_s,
            elapsed_s**2,
            squares_mm2,
            away_mm,
            elapsed_s[:, np.newaxis] * away_mm,
            poses.ijk,
            poses.angles_rad - first.angles_rad,
        )
        # One after the other: no bit depends on how the stream is cut into blocks.
        rows = np.vstack([self._sums, np.column_stack(columns)])
        self._sums = np.add.accumulate(rows, axis=0)[-1]
        self._times_s, self._squares_s2, self._squares_mm2 = self._sums[:3].tolist()
        self._sums_mm, self._moments_mm_s = self._sums[3:6], self._sums[6:9]
        self._sums_ijk, self._sums_rad = self._sums[9:12], self._sums[12:]
        self._quality |= int(np.bitwise_or.reduce(poses.quality))
        self.n += len(poses.seq)
        self.time_bound_ns = max(self.time_bound_ns, poses.time_bound_ns)
        self.last_ns = int(poses.sample_time_ns[-1])
        self._counts = poses.counts[-1]

    @property
    def spread_mm(self) -> float:
        """Root mean square distance of the samples from their mean."""
        mean_mm = self._sums_mm / self.n
        square_mm2 = self._squares_mm2 / self.n - float(mean_mm @ mean_mm)
        return float(np.sqrt(max(square_mm2, 0.0)))

    @property
    def speed_mm_s(self) -> float | None:
        """Speed of the ball over all samples; None if it is too early to know."""
        if self.n < 3 or self.last_ns - int(self._first.sample_time_ns[0]) < SPEED_NS:
            return None
        square_s2 = self._squares_s2 - self._times_s**2 / self.n
        slopes = (
            self._moments_mm_s - self._times_s * self._sums_mm / self.n
        ) / square_s2
        return float(np.linalg.norm(slopes))

    def check_begin(self) -> None:
        """Refuse at once if the arm moves, or its probe was changed.

        Raises:
            CaptureRefusedError: with the speed, or the change.
        """
        if self.is_mixed:
            raise CaptureRefusedError(
                "the probe was changed while samples were averaged",
                "take the point again",
            )
        self._check_speed(self.begin_speed_mm_s, "when samples were to be averaged")

    def check(self) -> None:
        """Refuse samples that are no mean of one place.

        Raises:
            CaptureRefusedError: with the reason and its size.
        """
        if not self.n:
            return
        limits = self._limits
        self._check_speed(self.speed_mm_s, "while samples were averaged")
        if self.spread_mm > limits.spread_mm:
            raise CaptureRefusedError(
                f"{self.n} averaged samples spread by {self.spread_mm:.3g} mm; the "
                f"limit is {limits.spread_mm:g} mm",
                "hold the probe still, then take the point again",
            )
        if self._quality & UNUSABLE_FLAGS:
            names = ", ".join(
                str(flag.name).lower()
                for flag in QualityFlag(self._quality & UNUSABLE_FLAGS)
            )
            raise CaptureRefusedError(
                f"samples to be averaged are flagged {names}",
                "see the device's events, then take the point again",
            )

    def _check_speed(self, speed_mm_s: float | None, when: str) -> None:
        limit_mm_s = self._limits.speed_mm_s
        if speed_mm_s is not None and speed_mm_s > limit_mm_s:
            raise CaptureRefusedError(
                f"the arm moved at {speed_mm_s:.3g} mm/s {when}; the limit is "
                f"{limit_mm_s:g} mm/s",
                "hold the probe still, then take the point again",
            )

    def pose(self) -> LatchedPose:
        """Mean pose, at the mean of the instants, with the last counts.

        Its block has only the readings, `Pipeline.block_at` has the rest.
        """
        first, n = self._first, self.n
        angles_rad = first.angles_rad[0] + self._sums_rad / n
        ijk = self._sums_ijk / np.linalg.norm(self._sums_ijk)
        return LatchedPose(
            int(first.sample_time_ns[0]) + round(1e9 * self._times_s / n),
            self._counts,
            angles_rad,
            first.xyz_mm[0] + self._sums_mm / n,
            ijk,
            self._quality,
            Block(angles_rad[np.newaxis]),
        )

    def refuse_if_over_time(self, now_ns: int, wait_ns: int) -> None:
        """Refuse if samples do not arrive, or take too long.

        Raises:
            CaptureRefusedError: with the number of samples.
        """
        end_ns = self.last_ns if self._end_ns is None else self._end_ns
        if (
            now_ns > end_ns + wait_ns
            or now_ns > self._begin_ns + MAX_AVERAGING_NS + wait_ns
        ):
            of_all = "" if self._samples is None else f" of {self._samples}"
            raise CaptureRefusedError(
                f"{counted(self.n, 'sample', 'were')} averaged{of_all}, then no more "
                "arrived",
                "see the device's events; average fewer samples, or for a shorter time",
            )
