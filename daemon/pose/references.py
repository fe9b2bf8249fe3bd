"""Which devices' positions are only assumed: after a loss of power, or by whole turns.

A device that has been without power may count from another place, unless its encoders
are absolute. An absolute encoder reports its place within a turn, not how many turns
its joint has made; that matters where the pose is not the same a turn later, and where
the joint's end stops do not exclude another turn. Until the operator confirms, every
measurement is flagged `turns_uncertain`.

Turns are counted from reading to reading. Where none was valid for so long that a joint
may have made half a turn more than its encoder counts, its turn is in doubt too.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass
from typing import Any

import numpy as np

from traverse.arrays import Floats, Indices, Integers
from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import CONFIRM
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.covariates import CovariateBuilder
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_MISSING,
    STATUS_STALE,
    CountSamples,
    DeviceUp,
    Identity,
)
from traverse.kinematics.effects.pose import corrected_pose

SAME_MM = 1e-6  # rounding moves the ball by less, an effect that matters by more
POSTURES_RAD = (0.3, 1.1)  # from the base posture, times the joint's number
CONDITION = "reference"  # of the table, which this feeds
PLACE, TURN = "place", "turn"
MAX_SPEED_RAD_S = 20.0  # no joint turns faster, where a device's options do not say
SPEED_NS = 50_000_000  # speed is taken from so much before and after an outage
SPEED_RISE = 2.0  # a hand may have moved faster in between
LONG_AGO_NS = -(2**62)
NOT_READ = STATUS_ERROR | STATUS_MISSING | STATUS_STALE


class ReferenceMemory:
    """What has to be known of references after a restart of the daemon.

    Args:
        confirmed: by device, the power-up (`Identity.boot`) that was last confirmed.
        is_lost: it was kept, and cannot be read.

    Attributes:
        confirmed, is_lost: as given.
    """

    def __init__(
        self, confirmed: Mapping[str, str] | None = None, *, is_lost: bool = False
    ) -> None:
        self.confirmed = dict(confirmed or {})
        self.is_lost = is_lost

    def add(self, boots: Mapping[str, str]) -> None:
        """These power-ups are confirmed."""
        self.confirmed |= boots


@dataclass(frozen=True, slots=True)
class Outage:
    """A joint may have turned too far while it was not read.

    Attributes:
        place: the joint's in the monitor's ``channels``.
        seconds: for how long.
        after_ns: the time of the first reading after it.
        has_turned: the joint turned so fast before or after that a turn may be lost.
    """

    place: int
    seconds: float
    after_ns: int
    has_turned: bool


@dataclass(eq=False)
class OutageMonitor:
    """Finds joints of a device that may have turned too far while they were not read.

    Args:
        channels: of the joints, (k,).
        half_wraps_rad: half of the angle after which each count repeats, (k,).
        counts_per_turn: of each, (k,).
        max_speed_rad_s: no joint turns faster.
    """

    channels: Indices
    half_wraps_rad: Floats
    counts_per_turn: Integers
    max_speed_rad_s: InitVar[float]

    def __post_init__(self, max_speed_rad_s: float) -> None:
        self._excluded_ns = self.half_wraps_rad / max_speed_rad_s * 1e9
        self._shortest_ns = int(self._excluded_ns.min())
        # Of the last valid readings: times, numbers, and of which stream all were.
        self._last_ns = np.full(len(self.channels), LONG_AGO_NS)
        self._last_seq = np.zeros(len(self.channels), np.int64)
        self._all_read_ns, self._stream = LONG_AGO_NS, -1
        self._recent: deque[CountSamples] = deque(maxlen=3)  # without an outage

    def add(self, samples: CountSamples) -> list[Outage]:
        """Continue by a block; what it shows of outages."""
        if samples.stream != self._stream:
            self._last_seq[:] = -2  # some may be missing between two streams
        until_ns = int(samples.sample_time_ns[-1])
        is_read = not (samples.status & NOT_READ).any()
        found: list[Outage] = []
        if is_read and (
            until_ns - self._all_read_ns < self._shortest_ns
            or self._is_next(samples.seq)
        ):
            self._last_ns.fill(until_ns)
            self._last_seq.fill(samples.seq[-1])
            self._all_read_ns = until_ns
        else:
            places = range(len(self.channels))
            outages = [self._outage(samples, place) for place in places]
            found = [outage for outage in outages if outage is not None]
            self._all_read_ns = int(self._last_ns.min())
        if is_read:
            self._recent.append(samples)
        self._stream = samples.stream
        return found

    def _is_next(self, seq: Integers) -> bool:
        """Whether no sample is missing, neither before a block nor within it."""
        follows = (self._last_seq == seq[0] - 1).all()
        return bool(follows) and int(seq[-1] - seq[0]) == len(seq) - 1

    def _outage(self, samples: CountSamples, place: int) -> Outage | None:
        """The longest of one joint."""
        times_ns, _, seq = self._readings(samples, place)
        if not len(times_ns):
            return None
        before_ns, before_seq = int(self._last_ns[place]), self._last_seq[place]
        self._last_ns[place], self._last_seq[place] = times_ns[-1], seq[-1]
        if before_ns == LONG_AGO_NS:
            return None
        # A device that is silent while nothing moves loses nothing.
        is_missing = np.diff(seq, prepend=before_seq) > 1
        gaps_ns = np.where(is_missing, np.diff(times_ns, prepend=before_ns), 0)
        gap_ns = int(gaps_ns.max())
        if gap_ns < self._excluded_ns[place]:
            return None
        after_ns = int(times_ns[gaps_ns.argmax()])
        parts = [self._readings(block, place) for block in (*self._recent, samples)]
        times_ns, counts, _ = map(np.concatenate, zip(*parts, strict=True))
        speeds = [
            self._speed_rad_s(times_ns[rows], counts[rows], place)
            for rows in (
                (times_ns >= after_ns - gap_ns - SPEED_NS) & (times_ns < after_ns),
                (times_ns >= after_ns) & (times_ns < after_ns + SPEED_NS),
            )
        ]
        fastest_rad_s = max((s for s in speeds if s is not None), default=np.inf)
        turned_rad = SPEED_RISE * fastest_rad_s * gap_ns * 1e-9
        has_turned = bool(turned_rad >= self.half_wraps_rad[place])
        return Outage(place, gap_ns * 1e-9, after_ns, has_turned)

    def _readings(
        self, block: CountSamples, place: int
    ) -> tuple[Integers, Integers, Integers]:
        """Times, counts and numbers of the valid readings of one joint in a block."""
        channel = self.channels[place]
        times_ns = block.sample_time_ns
        if block.skew_ns is not None:
            times_ns = times_ns + block.skew_ns[:, channel]
        rows = (block.status[:, channel] & NOT_READ) == 0
        counts = block.counts[rows, channel].astype(np.int64)
        return times_ns[rows], counts, block.seq[rows]

    def _speed_rad_s(
        self, times_ns: Integers, counts: Integers, place: int
    ) -> float | None:
        """Mean speed over readings closer than half a turn; None of less than two."""
        if len(times_ns) < 2 or times_ns[-1] <= times_ns[0]:
            return None
        turn = int(self.counts_per_turn[place])
        step = (int(counts[-1] - counts[0]) + turn // 2) % turn - turn // 2
        elapsed_s = int(times_ns[-1] - times_ns[0]) * 1e-9
        return abs(step) / turn * 2.0 * np.pi / elapsed_s


@dataclass(eq=False)
class ReferenceMonitor:
    """Knows which devices may count from another place, until the operator confirms.

    Args:
        section: of the configuration; its end stops limit how far joints turn.
        reset_turns: called with joints, from 0, whose end stops tell their turn, and
            the time [ns] from which on it is to be taken from them.
    """

    section: InitVar[QualitySection]
    model: InitVar[ArmModel]
    clock: HostClock
    conditions: ConditionMonitor
    memory: ReferenceMemory
    _: KW_ONLY
    reset_turns: Callable[[Sequence[int], int], None] = lambda joints, ns: None

    def __post_init__(self, section: QualitySection, model: ArmModel) -> None:
        self._outages: dict[str, OutageMonitor] = {}
        self._boots: dict[str, str] = {}
        self._moduli: dict[str, tuple[int, ...]] = {}
        self._doubts: dict[str, str] = {}
        self._follow(section, model)

    def _follow(self, section: QualitySection, model: ArmModel) -> None:
        self._model = model
        self._one_turn = one_turn_joints(section, model)
        self._turning = turn_dependent_joints(section, model, self.clock)

    @property
    def state(self) -> dict[str, object]:
        """What `resume` needs."""
        confirmed = dict(self.memory.confirmed)
        return {"doubts": dict(self._doubts), "confirmed": confirmed}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from the `state` of another time."""
        self._doubts = dict(state["doubts"])
        self.memory = ReferenceMemory(state["confirmed"])

    def use(self, section: QualitySection, model: ArmModel) -> None:
        """Follow another arm file or other end stops."""
        before: Sequence[int] = self._turning
        if not model.has_same_encoders(self._model):
            before = ()
            self._outages.clear()
        self._follow(section, model)
        for device in self._boots:
            joints = self._joints_of(device)
            if any(joint in self._turning and joint not in before for joint in joints):
                self._doubt(device, TURN)

    def on_up(self, up: DeviceUp) -> None:
        """A device has answered, perhaps after a loss of power."""
        device, boot = up.device, up.identity.boot
        joints = self._joints_of(device)
        if not joints:
            return
        if up.restarted or self._moduli.get(device) != up.identity.moduli_counts:
            self._outages.pop(device, None)
        self._moduli[device] = up.identity.moduli_counts
        is_first = device not in self._boots
        self._boots[device] = boot
        is_absolute = [self._is_absolute(joint, up.identity) for joint in joints]
        was_off, confirmed = up.restarted, self.memory.confirmed.get(device)
        if is_first:
            is_other = bool(boot and confirmed) and boot != confirmed
            is_unknown = not boot or confirmed is None
            was_off |= is_other or (is_unknown and False in is_absolute)
            was_off |= self.memory.is_lost
        if was_off and not all(is_absolute):
            self._doubt(device, PLACE)
            return
        if is_first and confirmed is None:
            self._remember([device])
        if (is_first or up.restarted) and any(j in self._turning for j in joints):
            self._doubt(device, TURN)
        if device not in self._doubts:
            self.conditions.establish(CONDITION, device)

    def add(self, samples: CountSamples, max_speed_rad_s: float | None = None) -> None:
        """A device's encoders have been read, perhaps not for a while."""
        device = samples.device
        known = self._outages.get(device)
        if known is None:
            known = self._outages[device] = self._monitor(device, max_speed_rad_s)
        if not (found := known.add(samples)):
            return
        joints, names = self._joints_of(device), self._model.effects.joint_names
        doubtful = []
        for outage in found:
            joint = joints[outage.place]
            if joint in self._one_turn:
                self.reset_turns([joint], outage.after_ns)
            elif outage.has_turned or joint in self._turning:
                # Elsewhere only an angle may be off, by whole turns, if it turned.
                doubtful.append((joint, outage.seconds))
        if doubtful:
            named = ", ".join(names[joint] for joint, _ in doubtful)
            longest_s = max(seconds for _, seconds in doubtful)
            self._doubt(
                device,
                TURN,
                f"{named} was not read for {longest_s:.2g} s and may have made a turn "
                "unseen: its angle, and what depends on it, may be off by whole turns",
                named,
            )

    def _monitor(self, device: str, max_speed_rad_s: float | None) -> OutageMonitor:
        model, joints = self._model, self._joints_of(device)
        turns = model.encoders.counts_per_turn[joints]
        wraps = model.wraps_counts(self._moduli)[joints]
        channels = model.channels[joints]
        speed_rad_s = max_speed_rad_s or MAX_SPEED_RAD_S
        return OutageMonitor(channels, np.pi * wraps / turns, turns, speed_rad_s)

    def confirm(self) -> list[str]:
        """Accept the present positions as right; gives the devices that it concerns."""
        devices = list(self._doubts)
        self._doubts.clear()
        for device in devices:
            text = f"the positions of {device} have been confirmed"
            self.conditions.establish(CONDITION, device, text)
        self._remember(devices)
        return devices

    def _remember(self, devices: Iterable[str]) -> None:
        boots = {d: self._boots[d] for d in devices if self._boots.get(d)}
        if boots:
            self.memory.add(boots)

    def _doubt(self, device: str, kind: str, text: str = "", named: str = "") -> None:
        known = self._doubts.get(device)
        if known in (kind, PLACE):
            return
        self._doubts[device] = kind
        names = self._model.effects.joint_names
        joints = self._joints_of(device)
        if kind == TURN:
            joints = [joint for joint in joints if joint in self._turning]
        named = named or ", ".join(names[joint] for joint in joints)
        if kind == PLACE:
            text = (
                f"{device} has been without power: {named} may count from another "
                "place, and every point may be wrong"
            )
            remedy = (
                "bring the arm to its reference, touch a point that you know, then "
                f"{CONFIRM}; for encoders that are absolute, write absolute = true in "
                "[joints.encoder] of the arm file"
            )
        else:
            text = text or (
                f"the turn of {named} is assumed, and the position depends on it"
            )
            remedy = (
                f"turn {named} to within half a turn of the base posture and restart, "
                f"or touch a point that you know and {CONFIRM}; for a joint that turns "
                "less, write its end stops in [[quality.end_stops]]"
            )
        self.conditions.doubt(CONDITION, device, text, remedy=remedy)

    def _joints_of(self, device: str) -> list[int]:
        return [j for j, d in enumerate(self._model.joint_devices) if d == device]

    def _is_absolute(self, joint: int, identity: Identity) -> bool | None:
        encoder = self._model.arm.joints[joint].encoder
        told = None if encoder is None else encoder.absolute
        return identity.absolute if told is None else told


def turn_dependent_joints(
    section: QualitySection, model: ArmModel, clock: HostClock
) -> tuple[int, ...]:
    """The joints of which a whole turn more or less would move the probe, from 0.

    Joints whose end stops leave one turn only, that nearest to zero, are left out.
    """
    zeros_rad = model.geometry.zeros_rad
    n_joints = len(zeros_rad)
    moved = np.zeros(n_joints, dtype=np.bool_)
    turns_rad = 2.0 * np.pi * np.vstack([np.zeros(n_joints), np.eye(n_joints)])
    for share in POSTURES_RAD:
        posture_rad = zeros_rad + share * np.arange(1, n_joints + 1)
        times_ns = np.full(n_joints + 1, clock.monotonic_ns())
        angles_rad, quality = posture_rad + turns_rad, np.zeros(n_joints + 1, np.uint32)
        builder = CovariateBuilder(model, clock)
        motion = builder.motion(times_ns, angles_rad, quality)
        block, _ = builder.block(
            times_ns, angles_rad, model.reference_temperature_c, quality, motion
        )
        xyz_mm, _, _ = corrected_pose(model.geometry, model.effects, block)
        moved |= np.linalg.norm(xyz_mm[1:] - xyz_mm[0], axis=1) > SAME_MM

    excluded = one_turn_joints(section, model)
    return tuple(j for j in np.flatnonzero(moved).tolist() if j not in excluded)


def one_turn_joints(section: QualitySection, model: ArmModel) -> tuple[int, ...]:
    """The joints, from 0, whose end stops leave one turn only, that nearest to zero."""
    zeros_rad = model.geometry.zeros_rad
    joints = {name: joint for joint, name in enumerate(model.effects.joint_names)}
    return tuple(
        joint
        for stop in section.end_stops
        if (joint := joints.get(stop.joint)) is not None
        and stop.low_rad >= zeros_rad[joint] - np.pi
        and stop.high_rad <= zeros_rad[joint] + np.pi
    )
