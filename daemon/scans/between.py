"""Instants of a scan between the samples of its stream, and samples at them.

A sample is found as a point at such an instant is: counts of every joint are
interpolated between its readings, whose number the scan's rate does not change.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.daemon.points.measurement import MeasurementContext
from traverse.daemon.pose.poses import JointCounts, LatchedPose, PoseBlock
from traverse.daemon.pose.uncertainty import MOST_JITTER_NS, CovarianceInput
from traverse.protocol.messages import QualityFlag


class ScanInstants:
    """Instant k is ``begin + k / rate``, where ``begin`` is the stream's first sample.

    Instants between two samples of which one in between was lost are lost, too.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = 1e9 / rate_hz
        self._begin_ns = self._next = 0
        self._last: tuple[int, int, int] | None = None  # stream, number and time

    def until(
        self, stream: int, seq: Integers, times_ns: Integers
    ) -> tuple[Integers, Integers]:
        """Return numbers and times of the next instants, (n,), up to a block's end.

        ``stream``, ``seq`` and ``times_ns`` (m,) are those of the block's samples.
        """
        begin_ns = int(times_ns[0])
        if self._last is None:
            self._begin_ns = begin_ns
        elif self._last[0] == stream:
            seq = np.append(self._last[1], seq)
            times_ns = np.append(self._last[2], times_ns)
            begin_ns = int(times_ns[0])
        self._last = stream, int(seq[-1]), int(times_ns[-1])
        first = max(self._next, int((begin_ns - self._begin_ns) // self._period_ns))
        end = int((times_ns[-1] - self._begin_ns) // self._period_ns) + 2
        numbers = np.arange(first, end)
        passed_ns = np.rint(numbers * self._period_ns).astype(np.int64)
        instants_ns = self._begin_ns + passed_ns
        is_due = (instants_ns >= begin_ns) & (instants_ns <= times_ns[-1])
        numbers, instants_ns = numbers[is_due], instants_ns[is_due]
        if len(numbers):
            self._next = int(numbers[-1]) + 1
        after = np.searchsorted(times_ns, instants_ns, side="left")
        before = np.maximum(after - 1, 0)
        is_kept = (seq[after] - seq[before] <= 1) | (times_ns[after] == instants_ns)
        return numbers[is_kept], instants_ns[is_kept]


def samples_between(
    stage: MeasurementContext, poses: PoseBlock, instants: ScanInstants
) -> tuple[PoseBlock, Floats] | None:
    """Return a scan's next samples (n,), and their covariances (n, 6).

    ``poses`` are the last ones of the stream. None where no sample is due, or all are
    left out for want of readings.
    """
    numbers, times_ns = instants.until(poses.stream, poses.seq, poses.sample_time_ns)
    if not len(times_ns):
        return None
    numbers_at = dict(zip(times_ns.tolist(), numbers.tolist(), strict=True))
    samples = [_sample(stage, at) for at in stage.resampler.at_instants(times_ns)]
    if not samples:
        return None
    sampled_poses = [pose for pose, _ in samples]
    sampled_ns = [pose.sample_time_ns for pose in sampled_poses]
    block = PoseBlock(
        poses.stream,
        np.array([numbers_at[time_ns] for time_ns in sampled_ns], np.int64),
        np.array(sampled_ns, np.int64),
        poses.received_ns,
        np.repeat(poses.inputs[-1:], len(samples)),
        np.array([pose.counts for pose in sampled_poses]),
        np.array([pose.angles_rad for pose in sampled_poses]),
        np.array([pose.xyz_mm for pose in sampled_poses]),
        np.array([pose.ijk for pose in sampled_poses]),
        np.array([pose.quality for pose in sampled_poses], np.uint32),
    )
    return block, np.concatenate([covariances_mm2 for _, covariances_mm2 in samples])


def _sample(stage: MeasurementContext, at: JointCounts) -> tuple[LatchedPose, Floats]:
    """Return the arm at one instant, and its covariance (1, 6), NaN if unknown."""
    model, temperature_c = stage.pipeline.model, stage.joint_devices.temperature_c
    pose = stage.pipeline.pose_at(at, temperature_c)
    pose = stage.skew.with_flags(model, pose)
    bound_ns = stage.resampler.time_bound_at_ns(at.sample_time_ns)
    speeds_rad_s = stage.trajectory.speeds_rad_s(at.sample_time_ns, pose.angles_rad)
    pose = stage.quality.with_flags(pose, speeds_rad_s, temperature_c)
    quality = pose.quality
    if speeds_rad_s is None:
        speeds_rad_s = np.full(len(pose.angles_rad), np.nan)
        if bound_ns:
            quality |= int(QualityFlag.MOTION_UNKNOWN)
    if bound_ns >= MOST_JITTER_NS:
        quality |= int(QualityFlag.TIME_UNCERTAIN)
    bounds_counts = at.error_bounds_counts
    reading = CovarianceInput(
        pose.block,
        speeds_rad_s[np.newaxis],
        None if bounds_counts is None else bounds_counts[np.newaxis],
        bound_ns,
    )
    covariance_mm2 = stage.uncertainty.covariances_mm2(model, reading)
    return replace(pose, quality=quality), covariance_mm2
