"""Inputs of the arm's effects beside the readings.

An unknown input is replaced by the one with the least effect (no motion, the reference
temperature), and the sample is flagged.
"""

import numpy as np

from traverse.arrays import Bits, Floats, Integers
from traverse.daemon.clock import HostClock
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.joint_motion import JointMotionTracker, Motion
from traverse.kinematics.effects.base.block import Block, Covariate
from traverse.protocol.messages import QualityFlag

APPROACH_BAND_RAD = 5e-5  # more than hands that rest tremble, less than any approach
APPROACH_BAND_COUNTS = 2  # a count may flicker without a motion


class CovariateBuilder:
    """Makes blocks of readings with the inputs of one arm's effects."""

    def __init__(self, model: ArmModel, clock: HostClock) -> None:
        self._clock = clock
        self._reference_c = model.reference_temperature_c
        needs = model.effects.needs
        covariates = {need.covariate for need in needs}
        self._wants_speed = Covariate.SPEED in covariates
        self._wants_temperature = Covariate.TEMPERATURE in covariates
        self._wants_utc = Covariate.UTC in covariates
        self._approaching = sorted(
            need.joint
            for need in needs
            if need.covariate is Covariate.APPROACH and need.joint is not None
        )
        per_count_rad = 2.0 * np.pi / model.encoders.counts_per_turn
        self._wants_motion = self._wants_speed or bool(self._approaching)
        self.motion_tracker = JointMotionTracker(
            np.maximum(APPROACH_BAND_RAD, APPROACH_BAND_COUNTS * per_count_rad)
        )

    def motion(
        self, times_ns: Integers, angles_rad: Floats, quality: Bits
    ) -> Motion | None:
        """Continue the stream by a block; None if no effect needs its motion.

        Args:
            times_ns: host monotonic times, (n_samples,).
            angles_rad: readings, (n_samples, n_joints).
            quality: bits so far, (n_samples,).
        """
        if not self._wants_motion:
            return None
        are_valid = (quality & QualityFlag.ENCODER_ERROR) == 0
        return self.motion_tracker.add(times_ns, angles_rad, are_valid)

    def at_instant(
        self,
        time_ns: int,
        angles_rad: Floats,
        temperature_c: float | None,
        quality: Bits,
    ) -> tuple[Block, Bits]:
        """Make the block of one latch, (n_joints,), without advancing the stream."""
        motion = None
        if self._wants_motion:
            motion = self.motion_tracker.at_instant(time_ns, angles_rad)
        times_ns = np.array([time_ns], dtype=np.int64)
        return self.block(
            times_ns, angles_rad[np.newaxis], temperature_c, quality, motion
        )

    def block(
        self,
        times_ns: Integers,
        angles_rad: Floats,
        temperature_c: float | None,
        quality: Bits,
        motion: Motion | None,
    ) -> tuple[Block, Bits]:
        """Make the block of some samples.

        Args:
            times_ns: host monotonic times, (n_samples,).
            angles_rad: readings, (n_samples, n_joints).
            temperature_c: of the arm; None without a sensor.
            quality: bits so far, (n_samples,).
            motion: of the same samples.

        Returns:
            The block, and `quality` with flags of missing inputs.
        """
        n = len(angles_rad)
        temperatures_c = None
        if self._wants_temperature:
            known_c = self._reference_c if temperature_c is None else temperature_c
            temperatures_c = np.full(n, known_c)
            if temperature_c is None:
                quality = quality | np.uint32(QualityFlag.TEMPERATURE_UNKNOWN)
        if motion is not None:
            is_unknown = (motion.approaches[:, self._approaching] == 0.0).any(axis=1)
            if self._wants_speed:
                is_unknown |= ~motion.are_speeds_known
            quality = quality | is_unknown * np.uint32(QualityFlag.MOTION_UNKNOWN)
        block = Block(
            angles_rad=angles_rad,
            speeds_rad_s=None if motion is None else motion.speeds_rad_s,
            approaches=None if motion is None else motion.approaches,
            temperature_c=temperatures_c,
            utc_ns=times_ns + self._clock.utc_offset_ns() if self._wants_utc else None,
        )
        return block, quality
