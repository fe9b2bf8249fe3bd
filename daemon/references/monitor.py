"""References of devices: which were confirmed, and whose positions are assumed.

A device that was without power may count from another position unless its encoders are
absolute; an unconfirmed one is unknown. An absolute encoder knows its position within a
turn, but not the joint's turn; that matters where a turn changes the pose and the
joint's end stops do not exclude it. Until the operator confirms or homes the joints,
the conditions `identity` and `reference` are not established, and every measurement is
flagged.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass, replace
from typing import Any

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import CONFIRM, HOME
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.references.joint_turns import (
    one_turn_joints,
    turn_dependent_joints,
)
from traverse.daemon.references.jumps import Jump, JumpMonitor
from traverse.daemon.references.known_devices import KnownDevices
from traverse.daemon.references.memory import (
    ConfirmedDevice,
    ReferenceMemory,
    arm_text,
)
from traverse.daemon.references.outages import Outage, OutageMonitor
from traverse.drivers.base.values import (
    CountSamples,
    DeviceUp,
    Identity,
    RepeatedCount,
)
from traverse.protocol.messages import QualityFlag

IDENTITY, REFERENCE = "identity", "reference"  # conditions that this feeds
PLACE, TURN = "place", "turn"
MAX_SPEED_RAD_S = 20.0  # no joint turns faster, where a device's options do not say
SAME_HOME_RAD = 0.01  # a posture that is found again by a pin, or by eye at marks


@dataclass(eq=False)
class ReferenceMonitor:
    """Feeds the conditions of device identity and joint reference.

    Args:
        section: end stops of the joints, and devices that nobody can exchange.
        reset_turns: called with joints, from 0, whose end stops determine their turn,
            and the time [ns] from which on.
        use_offsets: called with homing offsets by joint [rad] when they change.
    """

    section: InitVar[QualitySection]
    model: InitVar[ArmModel]
    clock: HostClock
    conditions: ConditionMonitor
    memory: InitVar[ReferenceMemory]
    published: PublishedNumbers
    _: KW_ONLY
    reset_turns: Callable[[Sequence[int], int], None] = lambda joints, ns: None
    use_offsets: Callable[[Mapping[str, float]], None] = lambda offsets_rad: None

    def __post_init__(
        self, section: QualitySection, model: ArmModel, memory: ReferenceMemory
    ) -> None:
        self._monitors: dict[str, tuple[OutageMonitor, JumpMonitor]] = {}
        self.devices = KnownDevices(section, model, memory)
        self._doubts: dict[str, str] = {}
        self._unhomed: dict[str, set[int]] = {}  # joints whose place is in doubt
        self._offsets_rad: dict[str, float] = {}
        self._follow(section, model)

    def _follow(self, section: QualitySection, model: ArmModel) -> None:
        self._model = model
        self._one_turn = one_turn_joints(section, model)
        self._turning = turn_dependent_joints(section, model, self.clock)

    @property
    def state(self) -> dict[str, object]:
        known = {
            name: it.to_values() for name, it in self.devices.memory.devices.items()
        }
        return {
            "doubts": dict(self._doubts),
            "unhomed": {name: sorted(it) for name, it in self._unhomed.items()},
            "confirmed": known,
            "offsets_rad": dict(self._offsets_rad),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        self._doubts = dict(state["doubts"])
        self._unhomed = {name: set(it) for name, it in state["unhomed"].items()}
        known = state["confirmed"].items()
        self.devices.memory = ReferenceMemory(
            {name: ConfirmedDevice.from_values(it) for name, it in known}
        )
        self._offsets_rad = dict(state["offsets_rad"])
        self.use_offsets(self._offsets_rad)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        before: Sequence[int] = self._turning
        is_other = (
            not model.has_same_encoders(self._model)
            or model.arm.home != self._model.arm.home
            or arm_text(model) != arm_text(self._model)
        )
        if is_other:
            before = ()
            self._monitors.clear()
        self.devices.use(section, model)
        self._follow(section, model)
        for device, identity in self.devices.identities.items():
            joints = self.devices.joints_of(device)
            if is_other and joints:
                self._take_up(DeviceUp(device, identity, restarted=False))
            if any(joint in self._turning and joint not in before for joint in joints):
                self._doubt_turns(device)

    # -- devices --------------------------------------------------------------

    def on_up(self, up: DeviceUp) -> None:
        """Check a device that has answered, perhaps after a loss of power."""
        device = up.device
        if not self.devices.joints_of(device):
            return
        before = self.devices.identities.get(device)
        moduli = None if before is None else before.moduli_counts
        if up.restarted or moduli != up.identity.moduli_counts:
            self._monitors.pop(device, None)
        self._take_up(up, is_back=before is not None)
        joints = self.devices.joints_of(device)
        if (before is None or up.restarted) and any(j in self._turning for j in joints):
            self._doubt_turns(device)

    def _take_up(self, up: DeviceUp, *, is_back: bool = False) -> None:
        device, identity = up.device, up.identity
        is_first = device not in self.devices.identities
        self.devices.add(device, identity)
        known = self.devices.confirmed(device)
        self._compare_serials(device, identity, known)
        self._keep_offsets(up, known)
        incremental = self.devices.incremental_of(device)
        if cause := self.devices.why_unknown(
            up, incremental, is_first=is_first, is_back=is_back
        ):
            some = incremental if self.devices.is_recognised(device) else ()
            self._doubt_place(device, cause, some or self.devices.joints_of(device))
            return
        keeps_place = not incremental or bool(identity.boot)
        is_as_confirmed = keeps_place and self.devices.is_recognised(device)
        if self._doubts.get(device) == PLACE and is_as_confirmed:
            del self._doubts[device]
        if device not in self._doubts:
            self.conditions.establish(REFERENCE, device)

    def _compare_serials(
        self, device: str, identity: Identity, known: ConfirmedDevice | None
    ) -> None:
        if known is not None and known.serials == identity.serials:
            self.conditions.establish(IDENTITY, device)
            return
        if identity.serials:
            text = self.devices.exchange_text(device)
            self.conditions.doubt(IDENTITY, device, f"{device}: {text}")

    # -- joints ---------------------------------------------------------------

    def add(
        self,
        samples: CountSamples,
        max_speed_rad_s: float | None = None,
        repeats: Sequence[RepeatedCount] = (),
    ) -> None:
        """Check a device's readings for outages and jumps.

        What follows on repeated readings is no jump.
        """
        device = samples.device
        monitors = self._monitors.get(device)
        if monitors is None:
            speed_rad_s = max_speed_rad_s or MAX_SPEED_RAD_S
            monitors = self._monitors[device] = self._new_monitors(device, speed_rad_s)
        outage_monitor, jump_monitor = monitors
        self._take_outages(device, outage_monitor.add(samples))
        channels = self._model.channels[self.devices.joints_of(device)]
        jumps = [
            jump
            for jump in jump_monitor.add(samples)
            if not any(
                repeat.channel == channels[jump.place]
                and repeat.since_ns <= jump.since_ns < repeat.until_ns
                for repeat in repeats
            )
        ]
        if jumps:
            self._take_jumps(samples, jumps)

    def _take_outages(self, device: str, outages: Sequence[Outage]) -> None:
        joints, names = self.devices.joints_of(device), self._model.effects.joint_names
        doubtful = []
        for outage in outages:
            joint = joints[outage.place]
            if joint in self._one_turn:
                self.reset_turns([joint], outage.after_ns)
            elif outage.has_turned or joint in self._turning:
                # Elsewhere only an angle may be off, by whole turns, if it turned.
                doubtful.append((joint, outage.seconds))
        if doubtful:
            named = ", ".join(names[joint] for joint, _ in doubtful)
            longest_s = max(seconds for _, seconds in doubtful)
            self._doubt_turns(
                device,
                f"{named} was not read for {longest_s:.2g} s and may have made a turn "
                "unseen: its angle, and what depends on it, may be off by whole turns",
                named,
            )

    def _take_jumps(self, samples: CountSamples, jumps: Sequence[Jump]) -> None:
        """Doubt a device of which counts have jumped, also after a restart."""
        device, names = samples.device, self._model.effects.joint_names
        if device not in self.devices.identities:
            return
        if known := self.devices.confirmed(device):
            self.devices.memory.add({device: replace(known, encoders="")})
        if self._doubts.get(device) == PLACE:
            return
        places = self.devices.joints_of(device)
        ways_rad = {places[jump.place]: jump.by_rad for jump in jumps}
        named = ", ".join(f"{names[j]} by {way:.2g} rad" for j, way in ways_rad.items())
        text, data = self.published.between(
            min(jump.since_ns for jump in jumps),
            int(samples.sample_time_ns[-1]),
            QualityFlag.TURNS_UNCERTAIN,
        )
        cause = (
            f"{device} has jumped as no joint moves ({named}){text}: it was set anew, "
            "its counter was reset, a coupling slips, or a reading was spoilt"
        )
        self._doubt_place(device, cause, [*ways_rad], data)

    def _new_monitors(
        self, device: str, max_speed_rad_s: float
    ) -> tuple[OutageMonitor, JumpMonitor]:
        model, joints = self._model, self.devices.joints_of(device)
        turns = model.encoders.counts_per_turn[joints]
        identity = self.devices.identities.get(device)
        moduli = {} if identity is None else {device: identity.moduli_counts}
        jitter_ns = 0 if identity is None else identity.jitter_ns
        wraps = model.wraps_counts(moduli)[joints]
        channels, count_rad = model.channels[joints], 2.0 * np.pi / turns
        return (
            OutageMonitor(channels, count_rad * wraps / 2.0, turns, max_speed_rad_s),
            JumpMonitor(channels, wraps, count_rad, jitter_ns, max_speed_rad_s),
        )

    # -- the operator ---------------------------------------------------------

    def confirm(self) -> dict[str, str]:
        """Accept devices and present positions.

        Returns:
            What was accepted, by device that was in doubt.
        """
        accepted = {}
        for device in self.devices.identities:
            is_other = not self.conditions.is_established(IDENTITY, device)
            if not is_other and device not in self._doubts:
                continue
            text = f"the positions of {device} have been confirmed"
            if is_other:
                text += f"; {self.devices.exchange_text(device)}"
            accepted[device] = text
        self._accept(accepted)
        return accepted

    def home(self, offsets_rad: Mapping[str, float]) -> dict[str, str]:
        """Take joints as homed, with offsets to their readings.

        Returns:
            What was accepted, by device whose reference is now established.
        """
        names = self._model.effects.joint_names
        before_rad = self._offsets_rad
        self._offsets_rad = {**before_rad, **offsets_rad}
        self.use_offsets(self._offsets_rad)
        moved = ", ".join(
            f"{joint} by {offset_rad - before_rad[joint]:.4f} rad"
            for joint, offset_rad in offsets_rad.items()
            if abs(offset_rad - before_rad.get(joint, offset_rad)) > SAME_HOME_RAD
        )
        accepted, homed = {}, {names.index(name) for name in offsets_rad}
        for device, identity in self.devices.identities.items():
            joints = set(self.devices.joints_of(device))
            if not joints & homed:
                continue
            left = self._unhomed.setdefault(device, set()) - homed
            self._unhomed[device] = left
            if left or self.devices.is_exchanged(device):
                continue
            known = self.devices.confirmed(device)
            accepted[device] = f"{device} has been homed"
            if moved:
                accepted[device] += (
                    f", elsewhere than before since its power-up ({moved}): one of the "
                    "two postures was not the home posture"
                )
            if known is None and identity.serials:
                accepted[device] += f"; {self.devices.exchange_text(device)}"
        self._accept(accepted)
        return accepted

    def _accept(self, accepted: Mapping[str, str]) -> None:
        self._remember(accepted)
        for device, text in accepted.items():
            self._doubts.pop(device, None)
            self._unhomed.pop(device, None)
            self.conditions.establish(IDENTITY, device, text)
            self.conditions.establish(REFERENCE, device, text)

    def _remember(self, devices: Iterable[str]) -> None:
        names = self._model.effects.joint_names
        confirmed = {}
        for device in devices:
            identity = self.devices.identities[device]
            joints = {names[joint] for joint in self.devices.joints_of(device)}
            offsets_rad = {j: a for j, a in self._offsets_rad.items() if j in joints}
            confirmed[device] = ConfirmedDevice(
                self.devices.encoders_text(device),
                identity.serials,
                identity.boot,
                identity.firmware,
                offsets_rad,
                self.devices.arm_text,
            )
        if confirmed:
            self.devices.memory.add(confirmed)

    def _keep_offsets(self, up: DeviceUp, known: ConfirmedDevice | None) -> None:
        """Use homing offsets as long as a device keeps its position."""
        names = self._model.effects.joint_names
        joints = {names[joint] for joint in self.devices.joints_of(up.device)}
        offsets_rad = {j: a for j, a in self._offsets_rad.items() if j not in joints}
        if (
            known is not None
            and not up.restarted
            and (known.serials, known.boot) == (up.identity.serials, up.identity.boot)
            and known.encoders == self.devices.encoders_text(up.device)
        ):
            offsets_rad |= known.offsets_rad
        if offsets_rad != self._offsets_rad:
            self._offsets_rad = offsets_rad
            self.use_offsets(offsets_rad)

    # -- doubts ---------------------------------------------------------------

    def _doubt_place(
        self,
        device: str,
        cause: str,
        joints: Sequence[int],
        data: Mapping[str, float | str] | None = None,
    ) -> None:
        self._doubts[device] = PLACE
        self._unhomed[device] = set(joints)
        named = self._named(joints)
        homed = once = ""
        if self._model.arm.home is not None:
            homed = f"bring the arm into its home posture, and {HOME}; or "
        if self.devices.incremental_of(device):
            once = (
                "; for encoders that are absolute, write absolute = true in "
                "[joints.encoder] of the arm file, and confirm once"
            )
        elif not self.devices.is_unique(device):
            once = (
                "; where nobody can exchange it, name it in assumed_devices of "
                "[quality]"
            )
        self.conditions.doubt(
            REFERENCE,
            device,
            f"{cause}: {named} may count from another place, and every point may be "
            "wrong",
            data,
            remedy=f"{homed}bring the arm to its reference, touch a point that you "
            f"know, then {CONFIRM}{once}",
        )

    def _doubt_turns(self, device: str, text: str = "", named: str = "") -> None:
        if device in self._doubts:
            return
        self._doubts[device] = TURN
        joints = [
            joint for joint in self.devices.joints_of(device) if joint in self._turning
        ]
        self._unhomed[device] = set(joints)
        named = named or self._named(joints)
        self.conditions.doubt(
            REFERENCE,
            device,
            text or f"the turn of {named} is assumed, and the position depends on it",
            remedy=f"turn {named} to within half a turn of the base posture and "
            f"restart, or touch a point that you know and {CONFIRM}; for a joint that "
            "turns less, write its end stops in [[quality.end_stops]]",
        )

    def _named(self, joints: Sequence[int]) -> str:
        names = self._model.effects.joint_names
        return ", ".join(names[joint] for joint in joints)
