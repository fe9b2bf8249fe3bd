"""Inputs and outputs of the pipeline."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers
from traverse.daemon.pose.joint_motion import Motion
from traverse.drivers.base.values import CountSamples
from traverse.kinematics.effects.base.block import Block


@dataclass(frozen=True, slots=True, eq=False)
class JointCounts:
    """Counts at one instant.

    Attributes:
        sample_time_ns: host monotonic time.
        counts: (n_joints,) uint32, within a turn.
        status: (n_joints,) uint8.
        fractions: (n_joints,) of a count, to be added; None for 0.
        error_bounds_counts: (n_joints, 2) by interpolation, see `Interpolated`; or
            None.
    """

    sample_time_ns: int
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]
    fractions: Floats | None = None
    error_bounds_counts: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ArmReadings:
    """Readings of n samples.

    Attributes:
        counts: (n, n_joints) unwrapped. angles_rad: (n, n_joints).
        quality: (n,) bits of the encoders' states.
        motion: None if no effect needs it.
    """

    samples: CountSamples
    counts: Integers
    angles_rad: Floats
    quality: NDArray[np.uint32]
    motion: Motion | None

    @classmethod
    def joined(cls, blocks: Sequence["ArmReadings"]) -> "ArmReadings":
        if len(blocks) == 1:
            return blocks[0]
        motions = [block.motion for block in blocks if block.motion is not None]
        return cls(
            CountSamples.joined([block.samples for block in blocks]),
            np.concatenate([block.counts for block in blocks]),
            np.concatenate([block.angles_rad for block in blocks]),
            np.concatenate([block.quality for block in blocks]),
            Motion.joined(motions) if motions else None,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PoseBlock:
    """Poses of n samples.

    Attributes:
        stream, seq: identify samples, see `traverse.drivers.base.values.CountSamples`.
        sample_time_ns: (n,) host monotonic time of the latch.
        received_ns: host monotonic time of the read.
        inputs: (n,) bits of the device's inputs.
        counts: (n, n_joints) unwrapped. angles_rad: (n, n_joints) readings.
        xyz_mm: (n, 3) ball centre. ijk: (n, 3) shank, from wrist to ball.
        quality: (n,) bits of `traverse.protocol.messages.QualityFlag`.
        time_bound_ns: how far the times may be off.
    """

    stream: int
    seq: Integers
    sample_time_ns: Integers
    received_ns: int
    inputs: NDArray[np.uint8]
    counts: Integers
    angles_rad: Floats
    xyz_mm: Floats
    ijk: Floats
    quality: NDArray[np.uint32]
    time_bound_ns: int = 0

    def rows(self, which: Booleans | slice) -> "PoseBlock":
        return replace(self, **{name: getattr(self, name)[which] for name in _ARRAYS})


_ARRAYS = (
    "seq",
    "sample_time_ns",
    "inputs",
    "counts",
    "angles_rad",
    "xyz_mm",
    "ijk",
    "quality",
)


@dataclass(frozen=True, slots=True, eq=False)
class LatchedPose:
    """Pose at one latch: arrays (n_joints,), (3,) and (3,) as in `PoseBlock`.

    Attributes:
        block: the one sample that it was computed from.
        error_bounds_counts: of interpolated readings, (n_joints, 2), see
            `Interpolated`; None if all were latched.
    """

    sample_time_ns: int
    counts: Integers
    angles_rad: Floats
    xyz_mm: Floats
    ijk: Floats
    quality: int
    block: Block
    error_bounds_counts: Floats | None = None
