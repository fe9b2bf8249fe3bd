"""State of the arm at one instant, or in the mean of many samples."""

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.averaging import AverageLimits, SampleAverage
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.points.compensation import (
    RetractDetector,
    TipCompensator,
    without_direction,
)
from traverse.daemon.points.observation import Observation
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.daemon.pose.quality_monitor import QualityMonitor
from traverse.daemon.pose.trajectory import TrajectoryBuffer
from traverse.daemon.pose.uncertainty import (
    MOST_JITTER_NS,
    CovarianceEvaluator,
    CovarianceInput,
    SkewMonitor,
    is_only_skewed,
)
from traverse.drivers.base.values import STATUS_LATE, STATUS_STALE, LatchedCounts
from traverse.kinematics.effects.base.block import Covariate
from traverse.kinematics.probing.compensation import DirectionError
from traverse.protocol.messages import QualityFlag


class MeasurementContext(ABC):
    """Context of points; `Measurement` composes it.

    Attributes:
        point_wait_ns: how long a point waits for the readings after its instant.
    """

    clock: HostClock
    conditions: ConditionMonitor
    joint_devices: JointDevices
    pipeline: Pipeline
    resampler: Resampler
    skew: SkewMonitor
    trajectory: TrajectoryBuffer
    uncertainty: CovarianceEvaluator
    quality: QualityMonitor
    point_wait_ns: int

    @abstractmethod
    def evaluate_readings(self) -> None:
        """Compute the deferred poses of readings."""


class PointEvaluator:
    """Follow the stream for all points that need more than their instant."""

    def __init__(
        self, stage: MeasurementContext, settings: CaptureSection, events: EventLog
    ) -> None:
        self._stage = stage
        self.tip = TipCompensator(settings, stage.trajectory)
        self._events = events
        self._dwell_ns = int(settings.average_s * 1e9)
        self._limits = AverageLimits(
            settings.average_speed_mm_s, settings.average_spread_mm
        )
        self._averages: list[SampleAverage] = []
        self._pulls: list[RetractDetector] = []

    @property
    def needs_poses(self) -> bool:
        return bool(self._averages or self._pulls) or self.tip.follows_stream

    def follow(self, poses: PoseBlock) -> None:
        for average in self._averages:
            average.add(poses)
        for pull in self._pulls:
            pull.add(poses)

    def look(self, observation: Observation) -> None:
        """Look up the state of the arm at an instant."""
        if observation.average is not None:
            return
        seen = observation.seen
        if seen is None:
            seen = self._evaluate(observation)
            if seen is None:
                return
            now_ns = self._stage.clock.monotonic_ns()
            if now_ns < observation.movable_until_ns and is_only_skewed(
                seen.pose.quality
            ):
                observation.instant_ns = now_ns
                return
            observation.seen = seen
            self._watch(observation, seen.pose.sample_time_ns, seen)
        # An edge may overtake samples from before it.
        time_ns = seen.pose.sample_time_ns
        if not self.tip.needs_trajectory or self._stage.trajectory.covers(time_ns):
            before_mm = self.tip.before(time_ns, seen.pose.xyz_mm)
            if before_mm is not seen.before_mm:
                observation.seen = replace(seen, before_mm=before_mm)
            observation.is_complete = True

    def start_average(
        self, observation: Observation, average: SampleAverage | None = None
    ) -> None:
        """Start the mean of samples from an instant on, by default as buttons do."""
        self._stage.evaluate_readings()
        begin_ns, path = observation.instant_ns, self._stage.trajectory
        if average is None:
            average = SampleAverage(begin_ns, None, self._dwell_ns, self._limits)
        average.begin_speed_mm_s = path.speed_mm_s(begin_ns)
        for block in path.between(begin_ns, self._stage.clock.monotonic_ns()):
            average.add(block)
        observation.average = average
        self._averages.append(average)
        # Its place is hardly known yet: good enough for a direction.
        here_mm = path.position_mm(begin_ns)
        if here_mm is not None:
            average.before_mm = self.tip.before(begin_ns, here_mm)

    def set_air_point(self, observation: Observation, *, is_last_chance: bool) -> bool:
        """Remember the ball's place in the air at an instant; False while it waits.

        Raises:
            CaptureRefusedError: its place is not known.
        """
        if observation.seen is None:
            if is_last_chance:
                raise CaptureRefusedError(*self._missing_reason(observation))
            return False
        self.tip.air_mm = observation.seen.pose.xyz_mm
        return True

    def measured(
        self, observation: Observation, *, is_last_chance: bool, is_crowded: bool
    ) -> PointMeasurement | None:
        """Measured values of a point at an instant; None while they have to wait.

        Raises:
            CaptureRefusedError: nothing, for a reason.
        """
        average, seen = observation.average, observation.seen
        if average is not None:
            if observation.mean is None:
                observation.mean = self._mean(average, is_last_chance, is_crowded)
                if observation.mean is not None:
                    self._watch(observation, average.last_ns, observation.mean)
            seen = observation.mean
        elif seen is None and (
            is_last_chance or self._stage.joint_devices.first_mismatched is not None
        ):
            raise CaptureRefusedError(*self._missing_reason(observation))
        if seen is None:
            return None
        pull, stage = observation.pull, self._stage
        if pull is not None and not is_crowded:
            now_ns = stage.clock.monotonic_ns()
            if not pull.is_over(stage.trajectory, now_ns, stage.point_wait_ns):
                return None
        try:
            return self.tip.compensated(seen, pull)
        except DirectionError as error:
            self._events.report(
                "warning",
                "capture.no_direction",
                str(error),
                remedy="take the point again with a known direction",
            )
            return without_direction(seen)

    def arm_changed(self) -> None:
        """Keep samples of the arm before a change out of means."""
        for average in self._averages:
            average.is_mixed = average.is_mixed or average.n > 0

    def forget(self, observation: Observation) -> None:
        if observation.average is not None:
            self._averages.remove(observation.average)
        if observation.pull is not None:
            self._pulls.remove(observation.pull)

    def _watch(
        self, observation: Observation, time_ns: int, measured: PointMeasurement
    ) -> None:
        if observation.pull is not None:
            self._pulls.remove(observation.pull)
        observation.pull = self.tip.pull(time_ns, measured.pose.xyz_mm)
        if observation.pull is not None:
            self._pulls.append(observation.pull)

    def _mean(
        self, average: SampleAverage, is_last_chance: bool, is_crowded: bool
    ) -> PointMeasurement | None:
        average.check_begin()
        if average.is_complete and average.n:
            average.check()
            return self._evaluate_mean(average)
        if is_crowded:
            raise CaptureRefusedError(
                "too many edges arrived while samples were averaged",
                "average while no button is pressed, or for a shorter time",
            )
        if is_last_chance or average.is_complete:
            now_ns = self._stage.clock.monotonic_ns()
            average.refuse_if_over_time(now_ns, self._stage.point_wait_ns)
        return None

    # -- the arm at an instant ---------------------------------------------------

    def _evaluate(self, observation: Observation) -> PointMeasurement | None:
        """State of the arm at an instant; None while it is not known."""
        stage = self._stage
        temperature_c = stage.joint_devices.temperature_c
        pose = self._pose(observation, temperature_c)
        if pose is None:
            return None
        latch, bound_ns = observation.latch, observation.time_bound_ns
        if pose.error_bounds_counts is not None:
            # An instant by another clock than that of the readings: what both leave
            # open moves all joints together.
            clocks_ns = stage.resampler.time_bound_at_ns(pose.sample_time_ns)
            bound_ns = max(clocks_ns, bound_ns)
        speeds_rad_s = stage.trajectory.speeds_rad_s(
            pose.sample_time_ns, pose.angles_rad
        )
        # Before a step of the host's time is flagged, which is no fault of the device.
        is_denied = self._is_denied(latch, pose)
        pose = stage.quality.with_flags(pose, speeds_rad_s, temperature_c)
        if speeds_rad_s is None and bound_ns:
            # How far a motion in that time leads cannot be stated.
            unknown = int(QualityFlag.MOTION_UNKNOWN)
            pose = replace(pose, quality=pose.quality | unknown)
        if bound_ns >= MOST_JITTER_NS or is_denied:
            unknown = int(QualityFlag.TIME_UNCERTAIN)
            pose = replace(pose, quality=pose.quality | unknown)
        measured = self._measured(
            pose,
            CovarianceInput(
                pose.block,
                np.full((1, len(pose.angles_rad)), np.nan)
                if speeds_rad_s is None
                else speeds_rad_s[np.newaxis],
                None
                if pose.error_bounds_counts is None
                else pose.error_bounds_counts[np.newaxis],
                self._jitter_ns(observation, bound_ns),
            ),
            temperature_c,
        )
        return replace(measured, time_bound_ns=bound_ns or None)

    def _jitter_ns(self, observation: Observation, bound_ns: int) -> int:
        """Return for how long the ball may have moved between an instant and counts.

        Strategy: counts that a device latched at an edge are the place of that edge,
        however well its clock is tied to the host's: only what the device itself leaves
        between the two moves the ball. An effect by the speed depends on the clock,
        too: a counter that stood still between a reading and the edge makes the joints
        seem faster.

        Args:
            observation: what was seen.
            bound_ns: how far its instant may be off.
        """
        stage, latch = self._stage, observation.latch
        if latch is None or not observation.is_edge or not self._is_at_once(latch):
            return bound_ns
        needs = stage.pipeline.model.effects.needs
        identity = stage.joint_devices.devices[0].identity
        if identity is None or any(n.covariate is Covariate.SPEED for n in needs):
            return bound_ns
        return identity.jitter_ns

    def _is_denied(self, latch: LatchedCounts | None, pose: LatchedPose) -> bool:
        """Return whether a latch was not at its instant, by readings or its arrival."""
        stage = self._stage
        if latch is None:
            return False
        # A whole latch and the readings have one counter: no host blunts the check.
        ticks = latch.device_ticks if self._is_at_once(latch) else None
        count_rad = np.abs(stage.pipeline.model.per_count_rad)
        is_known = stage.conditions.is_established("device_clock", latch.device)
        is_denied = stage.trajectory.denies(
            pose, count_rad, bound_ns=latch.time_bound_ns, ticks=ticks
        ) or (is_known and bool(pose.quality & QualityFlag.TIME_UNCERTAIN))
        if is_denied:
            stage.conditions.mark(
                "device_clock",
                latch.device,
                f"the time that {latch.device} states of a press or touch is not that "
                "of its counts, or later than its arrival",
            )
        return is_denied

    def _evaluate_mean(self, average: SampleAverage) -> PointMeasurement:
        """State of the arm in the mean of samples at rest."""
        stage, pose = self._stage, average.pose()
        temperature_c = stage.joint_devices.temperature_c
        block = stage.pipeline.block_at(
            pose.sample_time_ns, pose.angles_rad, temperature_c
        )
        at_rest = np.zeros((1, len(pose.angles_rad)))
        measured = self._measured(
            replace(pose, block=block),
            CovarianceInput(block, at_rest, samples=average.n),
            temperature_c,
        )
        spread_mm = None if average.n == 1 else average.spread_mm
        return replace(
            measured,
            time_bound_ns=average.time_bound_ns or None,
            samples=average.n,
            spread_mm=spread_mm,
            before_mm=average.before_mm,
        )

    def _missing_reason(self, observation: Observation) -> tuple[str, str]:
        """Why an instant has no state, and how to mend that."""
        first_mismatched = self._stage.joint_devices.first_mismatched
        if first_mismatched is not None:
            text = f"{first_mismatched.section.id} does not fit the arm file"
            return text, "see the event device.mismatch"
        lack = self._stage.resampler.missing_reason(
            observation.instant_ns, observation.latch
        )
        text = f"the joints are not known at the instant of the point: {lack}"
        return text, "see the device's events, then take the point again"

    def _measured(
        self, pose: LatchedPose, reading: CovarianceInput, temperature_c: float | None
    ) -> PointMeasurement:
        stage = self._stage
        model = stage.pipeline.model
        stated = stage.uncertainty.covariance(model, reading)
        return PointMeasurement(
            model, pose, temperature_c, stated.own_mm2, shared_mm=stated.shared_mm
        )

    def _pose(
        self, observation: Observation, temperature_c: float | None
    ) -> LatchedPose | None:
        stage, latch = self._stage, observation.latch
        if stage.joint_devices.first_mismatched is not None:
            return None
        if latch is not None and self._is_whole(latch):
            return stage.pipeline.latched_pose(latch, temperature_c)
        instant_ns = observation.instant_ns
        reading = stage.resampler.at(instant_ns, latch)
        is_waiting = stage.clock.monotonic_ns() < observation.deadline_ns
        # Motion at the instant follows from all samples before it, not from those that
        # happen to have arrived already: a replay finds the same, however it is cut.
        if reading is None or (is_waiting and not stage.trajectory.covers(instant_ns)):
            return None
        pose = stage.pipeline.pose_at(reading, temperature_c)
        return stage.skew.with_flags(stage.pipeline.model, pose)

    def _is_whole(self, latch: LatchedCounts) -> bool:
        """Whether one device reads all joints and has latched them."""
        devices = self._stage.joint_devices
        reads_all = devices.is_single and devices.devices[0].section.id == latch.device
        return reads_all and bool(latch.counts)

    def _is_at_once(self, latch: LatchedCounts) -> bool:
        """Whether these counts are of the very instant that the latch is about."""
        joint_devices = self._stage.joint_devices
        is_late = any(status & (STATUS_LATE | STATUS_STALE) for status in latch.status)
        return (
            joint_devices.has_simultaneous_latch
            and self._is_whole(latch)
            and not is_late
        )
