"""The measuring pipeline.

counts -> unwrapped counts -> angles -> inputs of effects -> corrected poses

Blocks of samples go to scans and the live view; a latch goes to the capture. Plain
calls, no queue, no waiting.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Bits, Floats
from traverse.daemon.clock import HostClock
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.covariates import CovariateBuilder
from traverse.daemon.pose.poses import (
    ArmReadings,
    JointCounts,
    LatchedPose,
    PoseBlock,
)
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_INTERPOLATED,
    STATUS_LATE,
    STATUS_MISSING,
    STATUS_STALE,
    STATUS_TIME_UNCERTAIN,
    STATUS_WARNING,
    CountSamples,
    LatchedCounts,
    are_valid,
)
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import PoseFlags, corrected_pose
from traverse.kinematics.model.readings import Encoders, Unwrapper
from traverse.protocol.messages import QualityFlag

FLAG_OF_STATUS = {
    STATUS_ERROR: QualityFlag.ENCODER_ERROR,
    STATUS_WARNING: QualityFlag.ENCODER_WARNING,
    STATUS_LATE: QualityFlag.LATE,
    STATUS_STALE: QualityFlag.STALE,
    STATUS_MISSING: QualityFlag.INCOMPLETE,
    STATUS_INTERPOLATED: QualityFlag.INTERPOLATED,
    STATUS_TIME_UNCERTAIN: QualityFlag.TIME_UNCERTAIN,
}
QUALITY_OF_STATUS: Bits = np.array(
    [sum(flag for bit, flag in FLAG_OF_STATUS.items() if s & bit) for s in range(256)],
    dtype=np.uint32,
)
"""Quality bits by status byte."""
QUALITY_OF_POSE = {
    "stale_effect": QualityFlag.STALE_EFFECT,
    "surface_unknown": QualityFlag.SURFACE_UNKNOWN,
    "empirical": QualityFlag.EMPIRICAL,
    "beyond_knots": QualityFlag.BEYOND_KNOTS,
}
"""Quality bits of effect flags."""


class Pipeline:
    """Turns latched counts into poses of the probe.

    Args:
        model: the arm; replaced between blocks by `use_model`.
    """

    def __init__(self, model: ArmModel, clock: HostClock) -> None:
        self._clock = clock
        self._unwrapper = Unwrapper(model.encoders)
        self._moduli: dict[str, tuple[int, ...]] = {}
        self._turn_resets: list[tuple[int, Sequence[int]]] = []
        self._homed_rad: dict[str, float] = {}
        self._set_model(model)

    def use_model(self, model: ArmModel) -> None:
        """Measure with ``model`` from the next sample on.

        Encoders that stay the same keep their turns.
        """
        if not _same_encoders(model.encoders, self.model.encoders):
            self._unwrapper = Unwrapper(model.encoders)
        self._set_model(model)

    def use_moduli(self, device: str, moduli_counts: tuple[int, ...]) -> None:
        """Set where a device's counts wrap, by channel, beyond one turn."""
        self._moduli[device] = moduli_counts
        self._unwrapper.use_wraps(self.model.wraps_counts(self._moduli))

    def reset_turns(self, joints: Sequence[int], from_ns: int) -> None:
        """Take turns of joints, from 0, as nearest to zero from a time on."""
        self._turn_resets.append((from_ns, joints))

    def _set_model(self, model: ArmModel) -> None:
        self.model = model
        self._unwrapper.use_wraps(model.wraps_counts(self._moduli))
        self._per_count_rad = model.per_count_rad
        self._follow_offsets()
        self._covariates = CovariateBuilder(model, self._clock)

    def use_offsets(self, offsets_rad: Mapping[str, float]) -> None:
        """Set the offsets of homing that are added to readings, by joint name."""
        self._homed_rad = dict(offsets_rad)
        self._follow_offsets()
        self._covariates.motion_tracker.forget()

    def _follow_offsets(self) -> None:
        names = self.model.effects.joint_names
        self._offsets_rad = np.array([self._homed_rad.get(name, 0.0) for name in names])
        self._unwrapper.use_zeros(self.model.encoders.zeros_rad - self._offsets_rad)

    def offsets_for(self, angles_rad: Mapping[str, float]) -> dict[str, float] | None:
        """Return offsets that give the named joints these angles now.

        None if a joint has not been read.
        """
        counts, fresh = self._unwrapper.turns
        names = self.model.effects.joint_names
        joints = [names.index(name) for name in angles_rad]
        if any(fresh[joint] for joint in joints):
            return None
        readings_rad = np.array(counts) * self._per_count_rad
        named_angles = zip(joints, angles_rad.items(), strict=True)
        return {
            name: float(angle_rad - readings_rad[joint])
            for joint, (name, angle_rad) in named_angles
        }

    @property
    def state(self) -> dict[str, object]:
        last, fresh = self._unwrapper.turns
        motion = self._covariates.motion_tracker.state
        return {"turns": last, "fresh": fresh, "motion": motion}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from an earlier `state` of the same arm."""
        self._unwrapper.resume(state["turns"], state["fresh"])
        self._covariates.motion_tracker.resume(state["motion"])

    def restart(self, device: str) -> None:
        """Reset the turn counters of a device that was without power."""
        joints = np.array(self.model.joint_devices) == device
        if joints.any():
            self._unwrapper.reset(joints)
            self._covariates.motion_tracker.forget()

    def poses(
        self, samples: CountSamples, temperature_c: float | None = None
    ) -> PoseBlock:
        """Compute poses of a block of samples, (n, ...), at the arm's temperature."""
        return self.evaluate(self.read(samples), temperature_c)

    def read(self, samples: CountSamples) -> ArmReadings:
        """Continue the stream by a block of samples.

        Samples with fractions are assembled: their channels are joints. Others are of
        the one device that reads the arm.
        """
        model = self.model
        if samples.fractions is None:
            status = samples.status.take(model.channels, axis=1)
            valid = are_valid(status) if status.any() else None
            raw = samples.counts.take(model.channels, axis=1)
            counts = self._unwrapper.unwrap(raw, valid)
            quality = _quality(status)
        else:
            counts = self._unwrapper.unwrap(samples.counts)
            quality = _quality(samples.status)
        until_ns = int(samples.sample_time_ns[-1])
        while self._turn_resets and self._turn_resets[0][0] <= until_ns:
            _, joints = self._turn_resets.pop(0)
            counts = self._unwrapper.with_turns_near_zero(counts, joints)
        # As `counts_to_angles`, and from where homing has put the zero.
        angles_rad = counts * self._per_count_rad + self._offsets_rad
        if samples.fractions is not None:
            angles_rad += samples.fractions * self._per_count_rad
        motion = self._covariates.motion(samples.sample_time_ns, angles_rad, quality)
        return ArmReadings(samples, counts, angles_rad, quality, motion)

    def evaluate(self, readings: ArmReadings, temperature_c: float | None) -> PoseBlock:
        """Compute poses of readings at the arm's temperature."""
        samples, angles_rad = readings.samples, readings.angles_rad
        times_ns = samples.sample_time_ns
        xyz_mm, ijk, quality = self._corrected(
            *self._covariates.block(
                times_ns, angles_rad, temperature_c, readings.quality, readings.motion
            )
        )
        return PoseBlock(
            samples.stream,
            samples.seq,
            times_ns,
            samples.received_ns,
            samples.inputs,
            readings.counts,
            angles_rad,
            xyz_mm,
            ijk,
            quality,
        )

    def latched_pose(
        self, latch: LatchedCounts, temperature_c: float | None = None
    ) -> LatchedPose:
        """Compute the pose at a latch of the device that reads all joints."""
        channels = self.model.channels
        return self.pose_at(
            JointCounts(
                latch.sample_time_ns,
                np.array(latch.counts, dtype=np.uint32)[channels],
                np.array(latch.status, dtype=np.uint8)[channels],
            ),
            temperature_c,
        )

    def pose_at(
        self, latched: JointCounts, temperature_c: float | None = None
    ) -> LatchedPose:
        """Compute the pose at one instant, with turns nearest to the last sample."""
        counts = self._unwrapper.near(latched.counts)
        angles_rad = counts * self._per_count_rad + self._offsets_rad
        if latched.fractions is not None:
            angles_rad += latched.fractions * self._per_count_rad
        status = int(np.bitwise_or.reduce(latched.status))
        quality = QUALITY_OF_STATUS[status : status + 1]
        block, quality = self._covariates.at_instant(
            latched.sample_time_ns, angles_rad, temperature_c, quality
        )
        xyz_mm, ijk, quality = self._corrected(block, quality)
        return LatchedPose(
            latched.sample_time_ns,
            counts,
            angles_rad,
            xyz_mm[0],
            ijk[0],
            int(quality[0]),
            block,
            latched.error_bounds_counts,
        )

    def block_of(self, readings: ArmReadings, temperature_c: float | None) -> Block:
        """Rebuild the block of readings, with the inputs of effects."""
        samples, quality = readings.samples, readings.quality
        block, _ = self._covariates.block(
            samples.sample_time_ns,
            readings.angles_rad,
            temperature_c,
            quality,
            readings.motion,
        )
        return block

    def block_at(
        self, time_ns: int, angles_rad: Floats, temperature_c: float | None
    ) -> Block:
        """Rebuild the block of one sample (n_joints,), with the inputs of effects."""
        quality = np.zeros(1, np.uint32)
        block, _ = self._covariates.at_instant(
            time_ns, angles_rad, temperature_c, quality
        )
        return block

    def _corrected(self, block: Block, quality: Bits) -> tuple[Floats, Floats, Bits]:
        model = self.model
        xyz_mm, ijk, flags = corrected_pose(model.geometry, model.effects, block)
        if model.effects.corrections:
            quality = quality | _quality_of_pose(flags)
        return xyz_mm, ijk, quality


def _same_encoders(first: Encoders, other: Encoders) -> bool:
    """Return whether counts of both have the same meaning."""
    return all(
        np.array_equal(getattr(first, name), getattr(other, name))
        for name in ("counts_per_turn", "signs", "zeros_rad")
    )


def _quality_of_pose(flags: PoseFlags) -> Bits:
    """Return quality bits (n,) of the effects' flags."""
    quality = np.zeros(len(flags.stale_effect), dtype=np.uint32)
    for name, flag in QUALITY_OF_POSE.items():
        quality[getattr(flags, name)] |= np.uint32(flag)
    return quality


def _quality(status: NDArray[np.uint8]) -> Bits:
    """Return quality bits (n,) of channel status (n, n_joints)."""
    joined: NDArray[np.uint8] = np.bitwise_or.reduce(status, axis=1)
    return QUALITY_OF_STATUS[joined]
