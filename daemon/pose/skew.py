"""What reading joints at different instants may do to a point, in millimetres.

With m_j and t_j how far the count of joint j may be off, by its motion and by its
instant (`traverse.daemon.acquisition.interpolation`), as angles, and l_j =
|dx/dalpha_j| for the ball,

    error = sum over j of l_j m_j  +  root of the sum over j of (l_j t_j)^2

The first is the most that the motions can do together: a hand accelerates all joints at
once. Instants are off by chance, each by itself.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.protocol.messages import QualityFlag

Floats = NDArray[np.float64]


class SkewMonitor:
    """Flags poses that are too much in doubt, and remembers the worst.

    Args:
        limit_mm: beyond it a pose is flagged ``skew``.
    """

    def __init__(self, limit_mm: float) -> None:
        self._limit_mm = limit_mm
        self._largest_mm: float | None = None

    def taken_mm(self) -> float | None:
        """The largest error since the last call; None where nothing was assembled."""
        largest_mm, self._largest_mm = self._largest_mm, None
        return largest_mm

    def flag_block(
        self, model: ArmModel, poses: PoseBlock, error_bounds_counts: Floats
    ) -> None:
        """Flag poses by the doubts (n, n_joints, 2) of their counts."""
        # The levers of the last pose do for a block: it spans milliseconds.
        errors_mm = _errors_mm(
            error_bounds_counts, _levers_mm(model, poses.angles_rad[-1])
        )
        self._note(float(errors_mm.max()))
        poses.quality[errors_mm > self._limit_mm] |= np.uint32(QualityFlag.SKEW)

    def marked(
        self, model: ArmModel, pose: LatchedPose, error_bounds_counts: Floats
    ) -> LatchedPose:
        """A pose, flagged by the doubts (n_joints, 2) of its counts."""
        levers_mm = _levers_mm(model, pose.angles_rad)
        error_mm = float(_errors_mm(error_bounds_counts[np.newaxis], levers_mm)[0])
        self._note(error_mm)
        if error_mm <= self._limit_mm:
            return pose
        return replace(pose, quality=pose.quality | QualityFlag.SKEW.value)

    def _note(self, error_mm: float) -> None:
        self._largest_mm = max(self._largest_mm or 0.0, error_mm)


def _errors_mm(error_bounds_counts: Floats, levers_mm: Floats) -> Floats:
    """Errors (n,) of doubts (n, n_joints, 2)."""
    by_motion = error_bounds_counts[:, :, 0] @ levers_mm
    by_instants = error_bounds_counts[:, :, 1] ** 2 @ levers_mm**2
    return np.asarray(by_motion + np.sqrt(by_instants))


def _levers_mm(model: ArmModel, angles_rad: Floats) -> Floats:
    """How far a count of each joint moves the ball, (n_joints,)."""
    derivatives = probe_derivatives(model.geometry, angles_rad[np.newaxis])
    levers_mm = np.linalg.norm(derivatives.by_angles[0], axis=0)
    return np.asarray(levers_mm * np.abs(model.per_count_rad))
