"""Live poses, thinned to a rate for displays."""

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.clock import HostClock
from traverse.daemon.pose.alignment import ActiveAlignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.pose.uncertainty import is_only_skewed
from traverse.kinematics.model.forward import joint_positions
from traverse.protocol.messages import Live, Quality


class LivePoseSampler:
    """Selects poses and makes their messages.

    A pose whose joints are not known at one instant, because an exchange took long,
    leaves its place to the next one that is, for at most a period.
    """

    def __init__(
        self, clock: HostClock, rate_hz: float, part: ActiveAlignment | None = None
    ) -> None:
        self._clock = clock
        self._part = part or ActiveAlignment()
        self.use_rate(rate_hz)
        self._due_ns = 0
        self._last: tuple[int, Floats] | None = None
        self.thinned = 0

    def use_rate(self, rate_hz: float) -> None:
        self._period_ns = int(1e9 / rate_hz)

    def message(
        self, model: ArmModel, poses: PoseBlock, session: str, device: str
    ) -> Live | None:
        """Return the last pose of a block, if one is due."""
        now_ns = int(poses.sample_time_ns[-1])
        xyz_mm = poses.xyz_mm[-1]
        due_ns = self._due_ns
        if is_only_skewed(int(poses.quality[-1])):
            due_ns += self._period_ns
        if now_ns < due_ns:
            self.thinned += 1
            return None
        self._due_ns = max(self._due_ns + self._period_ns, now_ns)
        speed_mm_s = None
        if self._last is not None and now_ns > self._last[0]:
            moved_mm = float(np.linalg.norm(xyz_mm - self._last[1]))
            speed_mm_s = moved_mm / (now_ns - self._last[0]) * 1e9
        self._last = (now_ns, xyz_mm)
        active = int(poses.inputs[-1])
        skeleton_mm = joint_positions(model.geometry, poses.angles_rad[-1:])[0]
        return Live(
            arm=model.name,
            model=model.digest,
            session=session,
            time_ns=self._clock.to_utc_ns(now_ns),
            xyz_mm=tuple(xyz_mm.tolist()),
            ijk=tuple(poses.ijk[-1].tolist()),
            part_xyz_mm=self._part.part_mm(xyz_mm),
            covariance_mm2=None,
            angles_rad=tuple(poses.angles_rad[-1].tolist()),
            skeleton_mm=tuple(tuple(row) for row in skeleton_mm.tolist()),
            speed_mm_s=speed_mm_s,
            probe_radius_mm=model.probe_radius_mm,
            inputs=tuple(f"{device}/{i}" for i in range(8) if active >> i & 1),
            quality=Quality.from_bits(int(poses.quality[-1])),
        )
