"""References of devices: which were confirmed, and whose positions are assumed.

A device that was without power may count from another position unless its encoders are
absolute; an unconfirmed one is unknown. An absolute encoder knows its position within a
turn, but not the joint's turn; that matters where a turn changes the pose and the
joint's end stops do not exclude it. Until the operator confirms or homes the joints,
the conditions `identity` and `reference` are not established, and every measurement is
flagged.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar, dataclass
from functools import partial
from typing import Any

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import CONFIRM, HOME
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.joint_turns import one_turn_joints, turn_dependent_joints
from traverse.daemon.pose.outages import OutageMonitor
from traverse.daemon.pose.reference_memory import (
    ConfirmedDevice,
    ReferenceMemory,
    encoders_text,
)
from traverse.daemon.pose.serial_numbers import changed_serials, new_serials
from traverse.drivers.base.values import CountSamples, DeviceUp, Identity

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
    memory: ReferenceMemory
    _: KW_ONLY
    reset_turns: Callable[[Sequence[int], int], None] = lambda joints, ns: None
    use_offsets: Callable[[Mapping[str, float]], None] = lambda offsets_rad: None

    def __post_init__(self, section: QualitySection, model: ArmModel) -> None:
        self._outages: dict[str, OutageMonitor] = {}
        self._identities: dict[str, Identity] = {}
        self._first_serials: dict[str, tuple[str, ...]] = {}  # in this run
        self._doubts: dict[str, str] = {}
        self._unhomed: dict[str, set[int]] = {}  # joints whose place is in doubt
        self._offsets_rad: dict[str, float] = {}
        self._follow(section, model)

    def _follow(self, section: QualitySection, model: ArmModel) -> None:
        self._model = model
        self._assumed = frozenset(section.assumed_devices)
        self._one_turn = one_turn_joints(section, model)
        self._turning = turn_dependent_joints(section, model, self.clock)

    @property
    def state(self) -> dict[str, object]:
        known = {name: it.to_values() for name, it in self.memory.devices.items()}
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
        self.memory = ReferenceMemory(
            {name: ConfirmedDevice.from_values(it) for name, it in known}
        )
        self._offsets_rad = dict(state["offsets_rad"])
        self.use_offsets(self._offsets_rad)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        before: Sequence[int] = self._turning
        is_other = (
            not model.has_same_encoders(self._model)
            or model.arm.home != self._model.arm.home
        )
        if is_other:
            before = ()
            self._outages.clear()
        self._follow(section, model)
        for device, identity in self._identities.items():
            joints = self._joints_of(device)
            if is_other and joints:
                self._take_up(DeviceUp(device, identity, restarted=False))
            if any(joint in self._turning and joint not in before for joint in joints):
                self._doubt_turns(device)

    # -- devices --------------------------------------------------------------

    def on_up(self, up: DeviceUp) -> None:
        """Check a device that has answered, perhaps after a loss of power."""
        device = up.device
        if not self._joints_of(device):
            return
        before = self._identities.get(device)
        moduli = None if before is None else before.moduli_counts
        if up.restarted or moduli != up.identity.moduli_counts:
            self._outages.pop(device, None)
        self._take_up(up, is_back=before is not None)
        joints = self._joints_of(device)
        if (before is None or up.restarted) and any(j in self._turning for j in joints):
            self._doubt_turns(device)

    def _take_up(self, up: DeviceUp, *, is_back: bool = False) -> None:
        device, identity = up.device, up.identity
        is_first = device not in self._identities
        self._identities[device] = identity
        self._first_serials.setdefault(device, identity.serials)
        known = self.memory.devices.get(device)
        self._compare_serials(device, identity, known)
        self._keep_offsets(up, known)
        incremental = self._incremental_joints(device, identity)
        if cause := self._why_unknown(
            up, known, incremental, is_first=is_first, is_back=is_back
        ):
            some = incremental if self._is_recognised(device) else ()
            self._doubt_place(device, cause, some or self._joints_of(device))
            return
        keeps_place = not incremental or bool(identity.boot)
        is_as_confirmed = keeps_place and self._is_recognised(device)
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
            text = self._exchange_text(device)
            self.conditions.doubt(IDENTITY, device, f"{device}: {text}")

    def _exchange_text(self, device: str) -> str:
        """Describe which serial numbers differ from the confirmed ones."""
        serials, known = (
            self._identities[device].serials,
            self.memory.devices.get(device),
        )
        joint_of = partial(self._joint, device)
        if known is not None and known.serials:
            return changed_serials(known.serials, serials, joint_of)
        text = new_serials(serials, is_lost=self.memory.is_lost)
        first = self._first_serials.get(device, serials)
        if first != serials:
            text += f"; {changed_serials(first, serials, joint_of)}"
        return text

    def _joint(self, device: str, channel: int) -> str:
        return self._model.joint_of(device, channel) or f"channel {channel}"

    def _why_unknown(
        self,
        up: DeviceUp,
        known: ConfirmedDevice | None,
        incremental: Sequence[int],
        *,
        is_first: bool,
        is_back: bool,
    ) -> str:
        """State why a device's positions are in doubt; empty if they are not.

        Args:
            up: What the device reported.
            known: What was confirmed of it.
            incremental: Its joints whose encoders are not known to be absolute.
            is_first: Whether it answers for the first time in this run.
            is_back: Whether it was lost meanwhile.
        """
        device, identity = up.device, up.identity
        if known is None:
            lost = ", or what was confirmed cannot be read" * self.memory.is_lost
            return f"{device} was never confirmed{lost}"
        if known.serials != identity.serials:
            return f"{device} is not the device that was confirmed"
        if change := self._change_of_counting(device, known):
            return change
        has_lost_power = up.restarted or bool(
            identity.boot and identity.boot != known.boot
        )
        # Where a family is absolute, its driver does not look for a loss of power.
        is_untold = not identity.boot and (is_first or bool(identity.absolute))
        if incremental and (has_lost_power or is_untold):
            cannot_tell = "" if has_lost_power else "cannot tell whether it "
            return f"{device} {cannot_tell}has been without power"
        # Another one answers like this one; boards with one switch even count alike.
        if (is_first or is_back) and not self._is_recognised(device):
            return f"no serial number shows that {device} is what was confirmed"
        return ""

    def _change_of_counting(self, device: str, known: ConfirmedDevice) -> str:
        """State what says that a device counts otherwise; empty if nothing does."""
        if known.encoders != self._encoders_text(device):
            text = "counts, or is homed, otherwise than when confirmed"
            return f"{device}, or the arm file, {text}"
        firmware = self._identities[device].firmware
        if known.firmware not in ("", firmware):
            text = f"firmware {known.firmware} when confirmed, {firmware} now"
            return f"{device} may count otherwise: {text}"
        return ""

    def _encoders_text(self, device: str) -> str:
        moduli_counts = self._identities[device].moduli_counts
        return encoders_text(self._model, device, moduli_counts)

    def _is_recognised(self, device: str) -> bool:
        """Return whether an exchange of the confirmed device would be noticed."""
        boot, known = self._identities[device].boot, self.memory.devices.get(device)
        identities = self._identities.items()
        is_boot_its_own = boot not in {of.boot for n, of in identities if n != device}
        has_its_power = (
            known is not None and bool(boot) and boot == known.boot and is_boot_its_own
        )
        is_known = self._is_unique(device) or has_its_power
        return is_known or device in self._assumed

    def _is_unique(self, device: str) -> bool:
        """Return whether its serial numbers tell a device from any other."""
        identities = self._identities.items()
        other_serials = {
            s for name, of in identities if name != device for s in of.serials
        }
        serials = self._identities[device].serials
        is_whole = bool(serials) and all(serials) and len({*serials}) == len(serials)
        return is_whole and other_serials.isdisjoint(serials)

    # -- joints ---------------------------------------------------------------

    def add(self, samples: CountSamples, max_speed_rad_s: float | None = None) -> None:
        """Check a device's readings for outages."""
        device = samples.device
        known = self._outages.get(device)
        if known is None:
            known = self._outages[device] = self._monitor(device, max_speed_rad_s)
        if not (outages := known.add(samples)):
            return
        joints, names = self._joints_of(device), self._model.effects.joint_names
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

    def _monitor(self, device: str, max_speed_rad_s: float | None) -> OutageMonitor:
        model, joints = self._model, self._joints_of(device)
        turns = model.encoders.counts_per_turn[joints]
        identity = self._identities.get(device)
        moduli = {} if identity is None else {device: identity.moduli_counts}
        wraps = model.wraps_counts(moduli)[joints]
        channels = model.channels[joints]
        speed_rad_s = max_speed_rad_s or MAX_SPEED_RAD_S
        return OutageMonitor(channels, np.pi * wraps / turns, turns, speed_rad_s)

    @property
    def incremental_joints(self) -> tuple[str, ...]:
        """Joints, by name, whose encoders are not known to be absolute."""
        names = self._model.effects.joint_names
        return tuple(
            names[joint]
            for device, identity in self._identities.items()
            for joint in self._incremental_joints(device, identity)
        )

    # -- the operator ---------------------------------------------------------

    def confirm(self) -> dict[str, str]:
        """Accept devices and present positions.

        Returns:
            What was accepted, by device that was in doubt.
        """
        accepted = {}
        for device in self._identities:
            is_other = not self.conditions.is_established(IDENTITY, device)
            if not is_other and device not in self._doubts:
                continue
            text = f"the positions of {device} have been confirmed"
            if is_other:
                text += f"; {self._exchange_text(device)}"
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
        for device, identity in self._identities.items():
            joints = set(self._joints_of(device))
            if not joints & homed:
                continue
            left = self._unhomed.setdefault(device, set()) - homed
            self._unhomed[device] = left
            known = self.memory.devices.get(device)
            is_other = known is not None and known.serials != identity.serials
            if left or is_other:
                continue
            accepted[device] = f"{device} has been homed"
            if moved:
                accepted[device] += (
                    f", elsewhere than before since its power-up ({moved}): one of the "
                    "two postures was not the home posture"
                )
            if known is None and identity.serials:
                accepted[device] += f"; {self._exchange_text(device)}"
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
            identity = self._identities[device]
            joints = {names[joint] for joint in self._joints_of(device)}
            offsets_rad = {j: a for j, a in self._offsets_rad.items() if j in joints}
            confirmed[device] = ConfirmedDevice(
                self._encoders_text(device),
                identity.serials,
                identity.boot,
                identity.firmware,
                offsets_rad,
            )
        if confirmed:
            self.memory.add(confirmed)

    def _keep_offsets(self, up: DeviceUp, known: ConfirmedDevice | None) -> None:
        """Use homing offsets as long as a device keeps its position."""
        names = self._model.effects.joint_names
        joints = {names[joint] for joint in self._joints_of(up.device)}
        offsets_rad = {j: a for j, a in self._offsets_rad.items() if j not in joints}
        if (
            known is not None
            and not up.restarted
            and (known.serials, known.boot) == (up.identity.serials, up.identity.boot)
            and known.encoders == self._encoders_text(up.device)
        ):
            offsets_rad |= known.offsets_rad
        if offsets_rad != self._offsets_rad:
            self._offsets_rad = offsets_rad
            self.use_offsets(offsets_rad)

    # -- doubts ---------------------------------------------------------------

    def _doubt_place(self, device: str, cause: str, joints: Sequence[int]) -> None:
        self._doubts[device] = PLACE
        self._unhomed[device] = set(joints)
        named = self._named(joints)
        homed = once = ""
        if self._model.arm.home is not None:
            homed = f"bring the arm into its home posture, and {HOME}; or "
        if self._incremental_joints(device, self._identities[device]):
            once = (
                "; for encoders that are absolute, write absolute = true in "
                "[joints.encoder] of the arm file, and confirm once"
            )
        elif not self._is_unique(device):
            once = (
                "; where nobody can exchange it, name it in assumed_devices of "
                "[quality]"
            )
        self.conditions.doubt(
            REFERENCE,
            device,
            f"{cause}: {named} may count from another place, and every point may be "
            "wrong",
            remedy=f"{homed}bring the arm to its reference, touch a point that you "
            f"know, then {CONFIRM}{once}",
        )

    def _doubt_turns(self, device: str, text: str = "", named: str = "") -> None:
        if device in self._doubts:
            return
        self._doubts[device] = TURN
        joints = [joint for joint in self._joints_of(device) if joint in self._turning]
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

    def _joints_of(self, device: str) -> list[int]:
        return [j for j, d in enumerate(self._model.joint_devices) if d == device]

    def _incremental_joints(self, device: str, identity: Identity) -> list[int]:
        joints = self._joints_of(device)
        return [joint for joint in joints if not self._is_absolute(joint, identity)]

    def _is_absolute(self, joint: int, identity: Identity) -> bool | None:
        encoder = self._model.arm.joints[joint].encoder
        stated = None if encoder is None else encoder.absolute
        return identity.absolute if stated is None else stated
