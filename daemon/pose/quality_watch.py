"""Marks what is measured beyond the limits of `[quality]`, or refuses it as a point."""

from dataclasses import replace

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.config.filters import flag_bits
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.limits import Floats, PoseLimits, SpeedTracker
from traverse.daemon.pose.persistent_flags import Standing
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.protocol.messages import FLAG_MEANINGS, QualityFlag
from traverse.protocol.messages.quality import flag_names

PASSING = {
    QualityFlag.END_STOP: "limit.end_stop",
    QualityFlag.SINGULAR: "limit.singular",
    QualityFlag.OVERSPEED: "limit.overspeed",
}
"""Limits that a hand passes in a moment; told when it does."""
LASTING = {
    QualityFlag.TEMPERATURE: "limit.temperature",
    QualityFlag.STALE_IDENTIFICATION: "limit.stale_identification",
}
"""Limits that are passed for long; told when it begins and when it ends."""
REMEDIES = {
    QualityFlag.END_STOP: "turn the joint back, or take the part from another side",
    QualityFlag.SINGULAR: "bend the arm",
    QualityFlag.OVERSPEED: "move slower",
    QualityFlag.TEMPERATURE: "wait until the temperature has settled",
    QualityFlag.STALE_IDENTIFICATION: "check the arm, and identify it again",
}


class QualityMonitor:
    """Looks at everything that is measured.

    Args:
        section: of the configuration.
        model: the arm.
        clock: the host's.
        events: where it is told that a limit is passed.
    """

    def __init__(
        self,
        section: QualitySection,
        model: ArmModel,
        clock: HostClock,
        events: EventLog,
    ) -> None:
        self._events = events
        self.standing = Standing(section, model, clock)
        self._trail = SpeedTracker()
        self._before = 0
        self.use(section, model)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        """Follow other limits, for another arm."""
        self._section, self._model = section, model
        self._limits = PoseLimits(section, model)
        self._looks = bool(
            section.end_stops or section.singular_ratio or section.overspeed_mm_s
        )
        self._refused = flag_bits(section.refuse)
        self.standing.use(section, model)
        self._trail.forget()

    def use_model(self, model: ArmModel) -> None:
        """Look at another arm."""
        self.use(self._section, model)

    def flag_block(
        self, model: ArmModel, poses: PoseBlock, temperature_c: float | None
    ) -> None:
        """Flag the poses of a block, in place."""
        if model is not self._model:
            self.use_model(model)
        standing = self.standing.bits(temperature_c)
        told = standing
        if self._looks:
            found = self._limits.flags_of_angles(poses.angles_rad)
            if self._limits.limits_speed:
                found |= self._limits.flags_of_speed(
                    self._trail.speeds_mm_s(poses.sample_time_ns, poses.xyz_mm)
                )
            np.bitwise_or(poses.quality, found, out=poses.quality)
            told |= int(np.bitwise_or.reduce(found))
        if standing:
            np.bitwise_or(poses.quality, np.uint32(standing), out=poses.quality)
        if told != self._before:
            self._tell(told)

    def marked(
        self,
        pose: LatchedPose,
        speeds_rad_s: Floats | None,
        temperature_c: float | None,
    ) -> LatchedPose:
        """A pose beside the stream, flagged; speeds are (n_joints,), None: unknown."""
        found = self.standing.bits(temperature_c)
        if self._looks:
            limits, angles_rad = self._limits, pose.angles_rad
            found |= int(limits.flags_of_angles(angles_rad[np.newaxis])[0])
            if limits.limits_speed:
                speed_mm_s = limits.speed_mm_s(angles_rad, speeds_rad_s)
                found |= int(limits.flags_of_speed(np.array([speed_mm_s]))[0])
        if not found:
            return pose
        return replace(pose, quality=pose.quality | found)

    def check(self, quality: int) -> None:
        """Refuse a point with flags that must not be.

        Raises:
            CaptureRefusedError: saying which.
        """
        refused = quality & self._refused
        if refused:
            names = ", ".join(flag_names(refused))
            flags = [flag for flag in FLAG_MEANINGS if flag & refused]
            meanings = "; ".join(FLAG_MEANINGS[flag] for flag in flags)
            remedies = [REMEDIES[flag] for flag in flags if flag in REMEDIES]
            raise CaptureRefusedError(
                f"a point flagged {names} is not wanted: {meanings}",
                "; ".join(remedies) or "see the device's events",
            )

    def _tell(self, told: int) -> None:
        changed, self._before = told ^ self._before, told
        for flag, code in PASSING.items():
            if changed & told & flag:
                self._events.report(
                    "warning",
                    code,
                    FLAG_MEANINGS[flag],
                    source="quality",
                    remedy=REMEDIES[flag],
                )
        for flag, code in LASTING.items():
            if changed & flag:
                passed = bool(told & flag)
                self._events.change(
                    passed,
                    "warning",
                    code,
                    FLAG_MEANINGS[flag] if passed else "within its limits again",
                    source="quality",
                    remedy=REMEDIES[flag] if passed else "",
                )
