"""Limits of poses: end stops, singular postures, speed.

In a singular posture the ball cannot move in some direction: the smallest singular
value of J = dx/dalpha (3, n_joints) is 0. It is at most the reach of the arm, of which
its limit is a fraction.
"""

import numpy as np

from traverse.arrays import Bits, Booleans, Floats, Integers
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.protocol.messages import QualityFlag

SPEED_NS = 5_000_000  # over less the encoders' noise would be more than the speed
GAP_NS = 250_000_000  # the slowest stream has a sample every 100 ms


class PoseLimits:
    """Limits of a configuration, for one arm.

    Args:
        section: of the configuration, valid for the arm's joints.
    """

    def __init__(self, section: QualitySection, model: ArmModel) -> None:
        self._geometry = model.geometry
        self._singular = section.singular_ratio
        self._overspeed_mm_s = section.overspeed_mm_s
        joints = {name: joint for joint, name in enumerate(model.effects.joint_names)}
        stops = [stop for stop in section.end_stops if stop.joint in joints]
        self._stopped_names = [stop.joint for stop in stops]
        self._stopped = np.array([joints[stop.joint] for stop in stops], np.intp)
        self._low_rad = np.array([stop.low_rad + stop.margin_rad for stop in stops])
        self._high_rad = np.array([stop.high_rad - stop.margin_rad for stop in stops])
        lengths_mm = np.linalg.norm(model.geometry.links_mm, axis=1)
        self._reach_mm = float(
            lengths_mm.sum() + np.linalg.norm(model.geometry.probe_vector_mm)
        )

    @property
    def limits_speed(self) -> bool:
        return self._overspeed_mm_s is not None

    def flags_of_angles(self, angles_rad: Floats) -> Bits:
        """Return flags (n,) of readings (n, n_joints)."""
        quality = np.zeros(len(angles_rad), np.uint32)
        if len(self._stopped):
            near = self._near_stops(angles_rad).any(axis=1)
            quality |= near * np.uint32(QualityFlag.END_STOP)
        if self._singular is not None:
            moves = probe_derivatives(self._geometry, angles_rad).by_angles
            limit_mm = self._singular * self._reach_mm
            singular = _is_below(moves, limit_mm)
            quality |= singular * np.uint32(QualityFlag.SINGULAR)
        return quality

    def joints_near_stops(self, angles_rad: Floats) -> str:
        """Name joints near a stop in any of (n, n_joints) readings."""
        near = self._near_stops(angles_rad).any(axis=0)
        return ", ".join(np.array(self._stopped_names)[near])

    def _near_stops(self, angles_rad: Floats) -> Booleans:
        turned_rad = angles_rad[:, self._stopped]
        near: Booleans = turned_rad < self._low_rad
        return near | (turned_rad > self._high_rad)

    def flags_of_speed(self, speed_mm_s: Floats) -> Bits:
        """Return flags (n,) of speeds (n,); NaN for unknown."""
        if self._overspeed_mm_s is None:
            return np.zeros(len(speed_mm_s), np.uint32)
        fast = (speed_mm_s > self._overspeed_mm_s) * np.uint32(QualityFlag.OVERSPEED)
        unknown = np.isnan(speed_mm_s) * np.uint32(QualityFlag.MOTION_UNKNOWN)
        return np.asarray(fast | unknown)

    def speed_mm_s(self, angles_rad: Floats, speeds_rad_s: Floats | None) -> float:
        """Return the ball's speed at readings and joint speeds (n_joints,)."""
        if speeds_rad_s is None:
            return float("nan")
        moves = probe_derivatives(self._geometry, angles_rad[np.newaxis]).by_angles[0]
        return float(np.linalg.norm(moves @ speeds_rad_s))


class SpeedTracker:
    """Speed of the ball through a stream of blocks.

    Each is the mean since the latest sample some milliseconds older, independent of how
    the stream is cut.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin again after a gap."""
        self._times_ns = np.empty(0, np.int64)
        self._xyz_mm = np.empty((0, 3))

    def speeds_mm_s(self, times_ns: Integers, xyz_mm: Floats) -> Floats:
        """Continue by a nonempty block; return speeds (n,), NaN for unknown."""
        if len(self._times_ns) and times_ns[0] < self._times_ns[-1]:
            self.forget()
        n_before = len(self._times_ns)
        all_ns = np.maximum.accumulate(np.concatenate([self._times_ns, times_ns]))
        all_mm = np.concatenate([self._xyz_mm, xyz_mm])
        rows_now = np.arange(n_before, len(all_ns))
        since = np.searchsorted(all_ns, all_ns[rows_now] - SPEED_NS, side="right") - 1
        rows = np.maximum(since, 0)
        elapsed_ns = all_ns[rows_now] - all_ns[rows]
        known = (since >= 0) & (elapsed_ns <= GAP_NS)
        away_mm = np.linalg.norm(all_mm[rows_now] - all_mm[rows], axis=1)
        first = int(rows[-1])
        self._times_ns, self._xyz_mm = all_ns[first:], all_mm[first:]
        speeds = away_mm / np.where(known, elapsed_ns * 1e-9, 1.0)
        return np.where(known, speeds, np.nan)


def _is_below(moves: Floats, limit: float) -> Booleans:
    """Return where the smallest singular value of (n, 3, n_joints) is below a limit.

    J Jᵀ - limit² is then not positive definite (Sylvester's criterion).
    """
    margins = moves @ moves.transpose(0, 2, 1)
    margins[:, range(3), range(3)] -= limit**2
    first = margins[:, 0, 0]
    second = first * margins[:, 1, 1] - margins[:, 0, 1] ** 2
    return np.asarray(
        ~((first > 0.0) & (second > 0.0) & (np.linalg.det(margins) > 0.0))
    )
