"""The whole measurement path, top to bottom.

    counts -> unwrapped counts -> angles -> probe centre and shank -> poses

Blocks of timed samples go to the scan and to the live view; a latch at an edge or
on request goes to the capture. Plain calls, no queue, no waiting.
"""

import numpy as np
from numpy.typing import NDArray

from daemon.model import ArmModel
from daemon.poses import LatchedPose, PoseBlock
from drivers.values import (
    STATUS_ERROR,
    STATUS_LATE,
    STATUS_STALE,
    STATUS_WARNING,
    CountSamples,
    LatchedCounts,
)
from kinematics.forward import probe_pose
from kinematics.readings import Unwrapper, counts_to_angles
from protocol.messages import QualityFlag


def _quality_of_status() -> NDArray[np.uint16]:
    """For each status byte, its quality bits; the maker's own bits are a warning."""
    status = np.arange(256)
    makers = 0xFF & ~(STATUS_ERROR | STATUS_WARNING | STATUS_LATE | STATUS_STALE)
    quality = (
        ((status & STATUS_ERROR) != 0) * QualityFlag.ENCODER_ERROR
        | ((status & (STATUS_WARNING | makers)) != 0) * QualityFlag.ENCODER_WARNING
        | ((status & STATUS_LATE) != 0) * QualityFlag.LATE
        | ((status & STATUS_STALE) != 0) * QualityFlag.STALE
    )
    return np.asarray(quality, dtype=np.uint16)


QUALITY_OF_STATUS = _quality_of_status()


class Pipeline:
    """Turns what the device latched into poses of the probe.

    Args:
        model: the arm; a new one replaces it between two blocks by `use_model`.
    """

    def __init__(self, model: ArmModel) -> None:
        self.use_model(model)

    def use_model(self, model: ArmModel) -> None:
        """Measure with ``model`` from the next sample on."""
        self.model = model
        self._unwrapper = Unwrapper(model.encoders)

    def restart(self) -> None:
        """Forget the turns counted: the device has been away."""
        self._unwrapper.reset()

    def poses(self, samples: CountSamples) -> PoseBlock:
        """Poses of a block of timed samples, (n, ...)."""
        model = self.model
        counts = self._unwrapper.unwrap(samples.counts[:, model.channels])
        angles_rad = counts_to_angles(model.encoders, counts)
        xyz_mm, ijk = probe_pose(model.geometry, angles_rad)
        return PoseBlock(
            samples.stream,
            samples.seq,
            samples.sample_time_ns,
            samples.received_ns,
            samples.inputs,
            counts,
            angles_rad,
            xyz_mm,
            ijk,
            _quality(samples.status[:, model.channels]),
        )

    def latched_pose(self, latch: LatchedCounts) -> LatchedPose:
        """Pose at one latch; its turns are those nearest to the last timed sample."""
        model = self.model
        latched = np.array(latch.counts, dtype=np.uint32)[model.channels]
        counts = self._unwrapper.near(latched)
        status = np.array([latch.status], dtype=np.uint8)[:, model.channels]
        angles_rad = counts_to_angles(model.encoders, counts[np.newaxis])
        xyz_mm, ijk = probe_pose(model.geometry, angles_rad)
        return LatchedPose(
            latch.sample_time_ns,
            counts,
            angles_rad[0],
            xyz_mm[0],
            ijk[0],
            int(_quality(status)[0]),
        )


def _quality(status: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Quality bits (n,) of the channels' status (n, n_joints)."""
    joined: NDArray[np.uint8] = np.bitwise_or.reduce(status, axis=1)
    return QUALITY_OF_STATUS[joined]
