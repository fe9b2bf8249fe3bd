"""Faults of counts: encoders that freeze, are set anew or, at times, not read."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.honesty.arm import ArmTruth
from benchmarks.honesty.daemon import DaemonRun
from benchmarks.honesty.devices import Freeze, MountedDevice
from benchmarks.honesty.families import Family
from benchmarks.honesty.hub import Hub
from benchmarks.honesty.judge import Judge
from benchmarks.honesty.plan import FROZEN_KINDS, Plan, PlannedFault
from benchmarks.honesty.unread import LOOK_S, UnreadWatch
from traverse.daemon.references.jumps import least_jump_rad

COUNT_KINDS = (*FROZEN_KINDS, "preset", "unread")
STEP_S, QUICK_STEPS = 0.01, 15  # of joints that are seen to freeze
SEEN_SLACK_S = 0.25  # of blocks and checks
READINGS_THAT_TELL, NEARLY_RAD = 4.0, 1e-3  # of a jump


@dataclass(eq=False)
class CountFaults:
    """Faults of counts in one world, and what the judge has to know of each.

    Attributes:
        rng: the world's own.
        mounted: the world's devices, once they are built.
        daemon: returns the daemon that runs, if one does.
        note: called with lines for people.
    """

    plan: Plan
    family: Family
    rng: np.random.Generator
    truth: ArmTruth
    hub: Hub
    judge: Judge
    mounted: list[MountedDevice]
    daemon: Callable[[], DaemonRun | None]
    note: Callable[[str], None]

    def schedule(self, fault: PlannedFault) -> None:
        if fault.kind in FROZEN_KINDS:
            self._freeze(fault)
        elif fault.kind == "preset":
            self._preset(fault)
        elif fault.kind == "unread":
            self._watch_unread(fault)

    def unread_channel(self, fault: PlannedFault) -> int:
        """Return a channel of a device whose joint moves a good deal of the time."""
        joints = self.family.joints(fault.device)
        times_s = np.arange(fault.at_s, fault.at_s + fault.lasts_s, STEP_S)
        readings_rad = self.truth.course.readings_rad(times_s)[:, joints]
        ways_rad = np.abs(np.diff(readings_rad, axis=0)).sum(axis=0)
        moving = np.argsort(ways_rad)[len(ways_rad) // 2 :]
        return int(np.random.default_rng([self.plan.seed, 0x556E]).choice(moving))

    def _freeze(self, fault: PlannedFault) -> None:
        """Freeze counts once two joints have been quick, and stay so, if ever."""
        mounted = self.mounted[fault.device]
        joints, quick_rad_s = mounted.source.encoders.joints, self.family.quick_rad_s
        times_s = np.arange(fault.at_s, fault.at_s + fault.lasts_s, STEP_S)
        readings_rad = self.truth.course.readings_rad(times_s)
        is_quick = np.abs(np.diff(readings_rad, axis=0)) > quick_rad_s * STEP_S
        before = round(self.family.moving_s / STEP_S)
        windows = np.lib.stride_tricks.sliding_window_view(
            is_quick, before + QUICK_STEPS, axis=0
        )
        lasting = np.asarray(windows.all(axis=2))
        of_device = lasting[:, joints]
        enough = of_device.any(axis=1) & (lasting.sum(axis=1) > 1)
        if fault.kind == "frozen_device":
            enough &= lasting.sum(axis=1) > of_device.sum(axis=1)
        if not enough.any():
            return
        row = int(np.argmax(enough))
        channels = np.arange(len(joints))
        if fault.kind == "frozen_channel":
            channels = self.rng.choice(np.flatnonzero(of_device[row]), 1)
        from_s = float(times_s[row + before])
        mounted.source.freeze = Freeze(
            tuple(channels.tolist()), from_s, fault.at_s + fault.lasts_s
        )
        seen_s = from_s + self.family.still_s + SEEN_SLACK_S
        self.judge.pardon(from_s, seen_s)
        self.note(f"          {mounted.source.freeze}, shown by {seen_s:.3f} s")

    def _preset(self, fault: PlannedFault) -> None:
        mounted, housed = self.mounted[fault.device], self.hub.devices[fault.device]
        source = mounted.source
        channel = int(self.rng.integers(len(source.offsets)))
        per_turn = np.asarray(source.encoders.counts_per_turn)

        def set_anew() -> None:
            source.offsets = source.offsets.copy()
            source.offsets[channel] += round(fault.size * per_turn[channel])
            self._judge_jump(fault, channel)

        self.hub.at(fault.at_s, lambda: housed.live(self.hub.now_s))
        self.hub.at(fault.at_s, set_anew)

    def _judge_jump(self, fault: PlannedFault, channel: int) -> None:
        """Judge numbers until a jump shows, if it can in the present motion."""
        daemon, rate_hz = self.daemon(), self._rate_hz()
        if daemon is None or not rate_hz:
            return
        mounted = self.mounted[fault.device]
        encoders, monitors = mounted.source.encoders, daemon.jump_monitors()
        count_rad = 2.0 * np.pi / float(encoders.counts_per_turn[channel])
        about_s = self.hub.now_s + np.array([-STEP_S, STEP_S])
        way_rad = np.diff(self.truth.course.readings_rad(about_s), axis=0)[0]
        speed_rad_s = float(way_rad[encoders.joints[channel]]) / (2.0 * STEP_S)
        period_s = (1.0 if self.family.is_checked else 2.0) / rate_hz
        by_rad, least_rad = 2.0 * np.pi * abs(fault.size), NEARLY_RAD
        unknown_s = monitors[mounted.table.id].unknown_s
        least_rad += least_jump_rad(period_s, count_rad, speed_rad_s, unknown_s)
        if by_rad < least_rad:
            self.judge.note_unseen(fault.at_s)
            self.judge.tally.jump_rad = by_rad, least_rad
        else:
            shown_s = fault.at_s + READINGS_THAT_TELL * period_s + SEEN_SLACK_S
            self.judge.pardon(fault.at_s, shown_s)
        self.note(f"          jump of {by_rad:.4f} rad, {least_rad:.4f} can be seen")

    def _watch_unread(self, fault: PlannedFault) -> None:
        mounted = self.mounted[fault.device]
        watch = UnreadWatch(
            self.plan,
            fault,
            self.family,
            self.unread_channel(fault),
            self.truth.course,
            self.judge,
            lambda: mounted.device.wiring,
            self._rate_hz,
        )
        for at_s in np.arange(fault.at_s, self.plan.duration_s, LOOK_S).tolist():
            self.hub.at(at_s, lambda: watch.look(self.hub.now_s))

    def _rate_hz(self) -> float:
        daemon = self.daemon()
        return daemon.measurement.rate_hz if daemon else 0.0
