"""What is known of the arm at one instant, or of the mean of many samples."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.points.averaging import Average, mean_pose
from traverse.daemon.points.capture import Measured
from traverse.daemon.points.request_queue import Request
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import LatchedPose
from traverse.daemon.pose.quality_monitor import QualityMonitor
from traverse.daemon.pose.trajectory import TrajectoryBuffer
from traverse.daemon.pose.uncertainty import (
    CovarianceEvaluator,
    CovarianceInput,
    SkewMonitor,
)
from traverse.drivers.base.values import LatchedCounts


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """What points are made with.

    Attributes:
        point_wait_ns: how long a point waits for the readings after its instant.
    """

    clock: HostClock
    devices: JointDevices
    pipeline: Pipeline
    assembly: Resampler
    skew: SkewMonitor
    path: TrajectoryBuffer
    uncertainty: CovarianceEvaluator
    quality: QualityMonitor
    point_wait_ns: int


class ArmSight:
    """Sees the arm.

    Args:
        stage: what points are made with.
    """

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def at(self, request: Request) -> Measured | None:
        """The arm at the instant of a request; None while that is not known."""
        stage, jitter_ns = self._stage, 0
        temperature_c = stage.devices.temperature_c
        pose = self._pose(request, temperature_c)
        if pose is None:
            return None
        device = request.device
        if (
            device is not None
            and pose.error_bounds_counts is not None
            and device.identity
        ):
            jitter_ns = device.identity.jitter_ns
        speeds_rad_s = stage.path.speeds_rad_s(pose.sample_time_ns, pose.angles_rad)
        pose = stage.quality.with_flags(pose, speeds_rad_s, temperature_c)
        return self._measured(
            pose,
            CovarianceInput(
                pose.block, speeds_rad_s, pose.error_bounds_counts, jitter_ns
            ),
            temperature_c,
        )

    def mean(self, average: Average) -> Measured:
        """The arm as it was on the mean of samples, while it rested."""
        stage, pose = self._stage, average.pose()
        temperature_c = stage.devices.temperature_c
        block = stage.pipeline.block_at(
            pose.sample_time_ns, pose.angles_rad, temperature_c
        )
        at_rest = np.zeros(len(pose.angles_rad))
        measured = self._measured(
            mean_pose(average, block),
            CovarianceInput(block, at_rest, samples=average.n),
            temperature_c,
        )
        spread_mm = None if average.n == 1 else average.spread_mm
        return replace(
            measured,
            samples=average.n,
            spread_mm=spread_mm,
            before_mm=average.before_mm,
        )

    def lack(self, request: Request) -> tuple[str, str]:
        """Why nothing is known of an instant, and what to do."""
        first_mismatched = self._stage.devices.first_mismatched
        if first_mismatched is not None:
            text = f"{first_mismatched.section.id} does not fit the arm file"
            return text, "see the event device.mismatch"
        lack = self._stage.assembly.missing_reason(request.instant_ns, request.latch)
        text = f"the joints cannot be told at the instant of the point: {lack}"
        return text, "see the device's events, then take the point again"

    def _measured(
        self, pose: LatchedPose, reading: CovarianceInput, temperature_c: float | None
    ) -> Measured:
        stage = self._stage
        model = stage.pipeline.model
        covariance_mm2 = stage.uncertainty.covariance(model, reading)
        return Measured(model, pose, temperature_c, covariance_mm2)

    def _pose(
        self, request: Request, temperature_c: float | None
    ) -> LatchedPose | None:
        stage, latch = self._stage, request.latch
        if stage.devices.first_mismatched is not None:
            return None
        if latch is not None and self._is_whole(latch):
            return stage.pipeline.latched_pose(latch, temperature_c)
        instant_ns = request.instant_ns
        found = stage.assembly.at(instant_ns, latch)
        is_waiting = stage.clock.monotonic_ns() < request.deadline_ns
        # Motion at the instant is told by all samples before it, not by those that
        # happen to have come already: a replay finds the same, however it is cut.
        if found is None or (is_waiting and not stage.path.covers(instant_ns)):
            return None
        pose = stage.pipeline.pose_at(found.counts, temperature_c)
        pose = replace(pose, error_bounds_counts=found.error_bounds_counts)
        return stage.skew.with_flags(
            stage.pipeline.model, pose, found.error_bounds_counts
        )

    def _is_whole(self, latch: LatchedCounts) -> bool:
        """The one device that reads all joints has latched them."""
        devices = self._stage.devices
        alone = devices.is_single and devices.devices[0].section.id == latch.device
        return alone and bool(latch.counts)
