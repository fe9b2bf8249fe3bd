"""Samples of a scan at instants between those of its stream.

They are found as a point at such an instant is: counts of every joint are interpolated
between its readings, whose number the scan's rate does not change.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.daemon.points.measurement import MeasurementContext
from traverse.daemon.pose.poses import JointCounts, LatchedPose, PoseBlock
from traverse.daemon.pose.uncertainty import MOST_JITTER_NS, CovarianceInput
from traverse.protocol.messages import QualityFlag


def samples_between(
    stage: MeasurementContext, poses: PoseBlock, numbers: Integers, times_ns: Integers
) -> tuple[PoseBlock, Floats] | None:
    """Return samples with numbers and times (n,), and their covariances (n, 6).

    ``poses`` are the last ones of the stream, none of them before the samples. None
    if all are left out for want of readings.
    """
    if not len(times_ns):
        return None
    numbers_at = dict(zip(times_ns.tolist(), numbers.tolist(), strict=True))
    samples = [_sample(stage, at) for at in stage.resampler.at_instants(times_ns)]
    if not samples:
        return None
    found = [pose for pose, _ in samples]
    at_ns = [pose.sample_time_ns for pose in found]
    block = PoseBlock(
        poses.stream,
        np.array([numbers_at[time_ns] for time_ns in at_ns], np.int64),
        np.array(at_ns, np.int64),
        poses.received_ns,
        np.repeat(poses.inputs[-1:], len(found)),
        np.array([pose.counts for pose in found]),
        np.array([pose.angles_rad for pose in found]),
        np.array([pose.xyz_mm for pose in found]),
        np.array([pose.ijk for pose in found]),
        np.array([pose.quality for pose in found], np.uint32),
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
