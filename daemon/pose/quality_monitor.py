"""Limits of `[quality]`: flag samples beyond them, and refuse points."""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.clock import STEP_NS, HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.config.filters import flag_bits
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.limits import PoseLimits, SpeedTracker
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.protocol.messages import FLAG_MEANINGS, QualityFlag
from traverse.protocol.messages.quality import flag_names

DAY_S = 86_400.0
STEP_FLAGGED_NS = 1_000_000_000  # readings of before the step have been used by then
Alarm = tuple[str, int, int | str]

MOMENTARY = {
    QualityFlag.END_STOP: "limit.end_stop",
    QualityFlag.SINGULAR: "limit.singular",
    QualityFlag.OVERSPEED: "limit.overspeed",
}
"""Limits that are exceeded for a moment; reported each time."""
LASTING = {
    QualityFlag.TEMPERATURE: "temperature_band",
    QualityFlag.STALE_IDENTIFICATION: "identification_age",
}
"""Limits that are exceeded for long, and their conditions."""
LIMITS = int(QualityFlag.TEMPERATURE | QualityFlag.STALE_IDENTIFICATION)
REMEDIES = {
    QualityFlag.ENCODER_ERROR: "take the point again; if it stays, check the encoder",
    QualityFlag.END_STOP: "turn the joint back, or take the part from another side",
    QualityFlag.SINGULAR: "bend the arm",
    QualityFlag.OVERSPEED: "move slower",
    QualityFlag.TEMPERATURE: "wait until the temperature has settled",
    QualityFlag.STALE_IDENTIFICATION: "check the arm, and identify it again",
}


class PersistentFlags:
    """Flags of every measurement: temperature, age of the identification, alarms."""

    def __init__(
        self, section: QualitySection, model: ArmModel, clock: HostClock
    ) -> None:
        self._clock = clock
        self._utc_offset_ns = clock.utc_offset_ns()
        self._stepped_ns: int | None = None
        self._last_step_ns: int | None = None
        self._temperatures: deque[tuple[int, float]] = deque()
        self._alarms: set[Alarm] = set()
        self.use(section, model)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        """Use other limits, for another arm; history is kept."""
        self._section = section
        self._identified_s = model.identified_s
        self._limits_c = section.temperature_low_c, section.temperature_high_c
        self._are_configured = self._limits_c != (None, None)
        if not self._are_configured:
            self._limits_c = model.temperature_limits_c
        corrects = "an" if model.uses_temperature else "no"
        self._basis = (
            f"{model.temperature_margin_c:g} °C beyond those of the identification, "
            f"and {corrects} effect of the arm file corrects for the temperature"
        )
        self._channels = set(
            zip(model.joint_devices, model.channels.tolist(), strict=True)
        )

    def alarm(
        self, device: str, channel: int | None, code: int | str, raised: bool
    ) -> None:
        if channel is not None and (device, channel) in self._channels:
            alarm = (device, channel, code)
            (self._alarms.add if raised else self._alarms.discard)(alarm)

    def utc_step_s(self) -> float:
        """Return by how much UTC was set since the last call [s]; 0 if not."""
        offset_ns, before_ns = self._clock.utc_offset_ns(), self._utc_offset_ns
        self._utc_offset_ns = offset_ns
        if abs(offset_ns - before_ns) <= STEP_NS:
            return 0.0
        self._stepped_ns = self._last_step_ns = self._clock.monotonic_ns()
        return (offset_ns - before_ns) * 1e-9

    def is_before_step(self, time_ns: int) -> bool:
        """Return whether UTC was set since, or the host slept: which time it was?"""
        return self._last_step_ns is not None and time_ns < self._last_step_ns

    @property
    def temperatures(self) -> tuple[tuple[int, float], ...]:
        """Host monotonic times [ns] and the temperature since then."""
        return tuple(self._temperatures)

    def resume(self, temperatures: Iterable[tuple[int, float]]) -> None:
        self._temperatures = deque(temperatures)

    def on_device_up(self, device: str) -> None:
        """Drop alarms of a device; it reports them again."""
        self._alarms = {alarm for alarm in self._alarms if alarm[0] != device}

    def bits(self, temperature_c: float | None) -> int:
        """Return the flags at a temperature of the arm; None: unknown."""
        quality = int(QualityFlag.ENCODER_WARNING) if self._alarms else 0
        if self._is_out_of_band(temperature_c) or self._has_changed(temperature_c):
            quality |= QualityFlag.TEMPERATURE
        if self._is_old():
            quality |= QualityFlag.STALE_IDENTIFICATION
        if self._stepped_ns is not None:
            if self._clock.monotonic_ns() - self._stepped_ns < STEP_FLAGGED_NS:
                quality |= QualityFlag.TIME_UNCERTAIN
            else:
                self._stepped_ns = None
        return int(quality)

    def _is_out_of_band(self, temperature_c: float | None) -> bool:
        low_c, high_c = self._limits_c
        if temperature_c is None:
            return self._are_configured
        is_cold = low_c is not None and temperature_c < low_c
        return is_cold or (high_c is not None and temperature_c > high_c)

    def cause(self, flag: QualityFlag, temperature_c: float | None) -> str:
        """State why a limit is exceeded."""
        if flag is not QualityFlag.TEMPERATURE or not self._is_out_of_band(
            temperature_c
        ):
            return FLAG_MEANINGS[flag]
        shown = "unknown" if temperature_c is None else f"{temperature_c:.1f} °C"
        low, high = ("none" if c is None else f"{c:.1f} °C" for c in self._limits_c)
        basis = "as [quality] states" if self._are_configured else self._basis
        return f"the temperature is {shown}, its limits {low} and {high}: {basis}"

    def _has_changed(self, temperature_c: float | None) -> bool:
        """Return whether it rose or fell too much within the configured time."""
        limit_c = self._section.temperature_change_c
        if limit_c is None or temperature_c is None:
            return False
        now_ns = self._clock.monotonic_ns()
        seen = self._temperatures
        if not seen or seen[-1][1] != temperature_c:
            seen.append((now_ns, temperature_c))
        # A temperature holds until the next: the last before that time counts, too.
        oldest_ns = now_ns - int(self._section.temperature_time_s * 1e9)
        while len(seen) > 1 and seen[1][0] <= oldest_ns:
            seen.popleft()
        if len(seen) == 1:
            return False
        values_c = [value_c for _, value_c in seen]
        return max(values_c) - min(values_c) > limit_c

    def _is_old(self) -> bool:
        days = self._section.identification_days
        if days is None:
            return False
        if self._identified_s is None:
            return True  # its age is not known
        now_s = (self._clock.monotonic_ns() + self._clock.utc_offset_ns()) * 1e-9
        return now_s - self._identified_s > days * DAY_S


class QualityMonitor:
    """Flags every pose, also with the flags of all conditions."""

    def __init__(
        self,
        section: QualitySection,
        model: ArmModel,
        clock: HostClock,
        events: EventLog,
        conditions: ConditionMonitor,
    ) -> None:
        self._events = events
        self._conditions = conditions
        self.persistent = PersistentFlags(section, model, clock)
        self._speeds = SpeedTracker()
        self._last_flags = 0
        self._last_limits: int | None = None
        self.use(section, model)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        self._section, self._model = section, model
        self._last_limits = None
        self._limits = PoseLimits(section, model)
        self._has_pose_limits = bool(
            section.end_stops or section.singular_ratio or section.overspeed_mm_s
        )
        self._refused = flag_bits(section.refuse)
        self.persistent.use(section, model)
        self._speeds.forget()

    def use_model(self, model: ArmModel) -> None:
        """Use another arm."""
        self.use(self._section, model)

    def check_clock(self) -> None:
        """Report a step of the host's UTC; call with every step."""
        if step_s := self.persistent.utc_step_s():
            self._events.report(
                "warning",
                "clock.stepped",
                f"the host's clock was set {'forward' if step_s > 0 else 'back'} by "
                f"{abs(step_s):.3f} s, or the host slept; times before and after do "
                "not compare; measurements are flagged time_uncertain for a second",
                source="host",
                remedy="let the clock be set before measuring (chrony: makestep only "
                "at its start); take the last points again if their times matter",
                data={"step_s": step_s},
            )

    def flag_block(
        self,
        model: ArmModel,
        poses: PoseBlock,
        temperature_c: float | None,
        *,
        is_scanning: bool = True,
    ) -> None:
        """Flag the poses of a block, in place.

        The speed of an arm is reported only during a scan.
        """
        if model is not self._model:
            self.use_model(model)
        lasting = self.persistent.bits(temperature_c)
        self._feed_limits(lasting, temperature_c)
        persistent = lasting | self._conditions.bits
        flags = persistent
        if self._has_pose_limits:
            pose_flags = self._limits.flags_of_angles(poses.angles_rad)
            if self._limits.limits_speed:
                pose_flags |= self._limits.flags_of_speed(
                    self._speeds.speeds_mm_s(poses.sample_time_ns, poses.xyz_mm)
                )
            np.bitwise_or(poses.quality, pose_flags, out=poses.quality)
            flags |= int(np.bitwise_or.reduce(pose_flags))
        self._conditions.add_samples(int(np.bitwise_or.reduce(poses.quality)) | lasting)
        if persistent:
            np.bitwise_or(poses.quality, np.uint32(persistent), out=poses.quality)
        if not is_scanning:
            flags &= ~QualityFlag.OVERSPEED
        if flags != self._last_flags:
            self._report(flags, poses)

    def with_flags(
        self,
        pose: LatchedPose,
        speeds_rad_s: Floats | None,
        temperature_c: float | None,
    ) -> LatchedPose:
        """Flag a pose outside the stream; speeds are (n_joints,), None: unknown."""
        lasting = self.persistent.bits(temperature_c)
        self._feed_limits(lasting, temperature_c)
        self._conditions.add_samples(pose.quality | lasting)
        pose_flags = lasting | self._conditions.bits
        if self.persistent.is_before_step(pose.sample_time_ns):
            pose_flags |= QualityFlag.TIME_UNCERTAIN
        if self._has_pose_limits:
            limits, angles_rad = self._limits, pose.angles_rad
            pose_flags |= int(limits.flags_of_angles(angles_rad[np.newaxis])[0])
            if limits.limits_speed:
                speed_mm_s = limits.speed_mm_s(angles_rad, speeds_rad_s)
                pose_flags |= int(limits.flags_of_speed(np.array([speed_mm_s]))[0])
        if not pose_flags:
            return pose
        return replace(pose, quality=pose.quality | pose_flags)

    def check(self, quality: int) -> None:
        """Refuse a point with excluded flags; report one that was too fast.

        Raises:
            CaptureRefusedError: names the flag.
        """
        if quality & QualityFlag.OVERSPEED:
            self._report_momentary(QualityFlag.OVERSPEED)
        refused = quality & self._refused
        if refused:
            names = ", ".join(flag_names(refused))
            flags = [flag for flag in FLAG_MEANINGS if flag & refused]
            meanings = "; ".join(FLAG_MEANINGS[flag] for flag in flags)
            remedies = [REMEDIES[flag] for flag in flags if flag in REMEDIES]
            raise CaptureRefusedError(
                f"a point flagged {names} is not accepted: {meanings}",
                "; ".join(remedies) or "see the device's events",
            )

    def _report_momentary(self, flag: QualityFlag, joints: str = "") -> None:
        self._events.report(
            "warning",
            MOMENTARY[flag],
            f"{joints}: {FLAG_MEANINGS[flag]}" if joints else FLAG_MEANINGS[flag],
            source="quality",
            remedy=REMEDIES[flag],
        )

    def _report(self, flags: int, poses: PoseBlock) -> None:
        changed, self._last_flags = flags ^ self._last_flags, flags
        for flag in MOMENTARY:
            if changed & flags & flag:
                joints = ""
                if flag is QualityFlag.END_STOP:
                    joints = self._limits.joints_near_stops(poses.angles_rad)
                self._report_momentary(flag, joints)

    def _feed_limits(self, flags: int, temperature_c: float | None) -> None:
        limits = flags & LIMITS
        if limits == self._last_limits:
            return
        self._last_limits = limits
        for flag, condition in LASTING.items():
            if limits & flag:
                cause = self.persistent.cause(flag, temperature_c)
                self._conditions.doubt(condition, cause=cause)
            else:
                self._conditions.establish(condition, text="within its limits again")
