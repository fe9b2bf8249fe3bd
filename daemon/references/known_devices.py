"""Which devices answer, beside those that were confirmed.

A device is recognised by serial numbers of its own, or by the power that it has had
since it was confirmed; else another one may answer in its place.
"""

from collections.abc import Sequence
from functools import partial

from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.references.memory import (
    ConfirmedDevice,
    ReferenceMemory,
    arm_text,
    encoders_text,
)
from traverse.daemon.references.serial_numbers import changed_serials, new_serials
from traverse.drivers.base.values import DeviceUp, Identity


class KnownDevices:
    """The devices that read joints, as they answered in this run.

    Attributes:
        memory: of confirmed devices.
        identities: by device.
    """

    def __init__(
        self, section: QualitySection, model: ArmModel, memory: ReferenceMemory
    ) -> None:
        self.memory = memory
        self.identities: dict[str, Identity] = {}
        self._first_serials: dict[str, tuple[str, ...]] = {}  # in this run
        self.use(section, model)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        self._model = model
        self._assumed = frozenset(section.assumed_devices)

    def add(self, device: str, identity: Identity) -> None:
        """Take what a device answered."""
        self.identities[device] = identity
        self._first_serials.setdefault(device, identity.serials)

    def confirmed(self, device: str) -> ConfirmedDevice | None:
        return self.memory.devices.get(device)

    def exchange_text(self, device: str) -> str:
        """Describe which serial numbers differ from the confirmed ones."""
        serials, known = self.identities[device].serials, self.confirmed(device)
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

    def why_unknown(
        self,
        up: DeviceUp,
        incremental: Sequence[int],
        *,
        is_first: bool,
        is_back: bool,
    ) -> str:
        """State why a device's positions are in doubt; empty if they are not.

        Args:
            up: What the device reported.
            incremental: Its joints whose encoders are not known to be absolute.
            is_first: Whether it answers for the first time in this run.
            is_back: Whether it was lost meanwhile.
        """
        device, identity = up.device, up.identity
        known = self.confirmed(device)
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
        if (is_first or is_back) and not self.is_recognised(device):
            return f"no serial number shows that {device} is what was confirmed"
        return ""

    def _change_of_counting(self, device: str, known: ConfirmedDevice) -> str:
        """State what says that a device counts otherwise; empty if nothing does."""
        if known.encoders != self.encoders_text(device):
            text = "counts, or is homed, otherwise than when confirmed"
            return f"{device}, or the arm file, {text}"
        if not self._is_of_this_arm(known):
            return (
                f"{device} was confirmed with the arm file of {known.arm}, and it is "
                f"of {self.arm_text} now"
            )
        firmware = self.identities[device].firmware
        if known.firmware not in ("", firmware):
            text = f"firmware {known.firmware} when confirmed, {firmware} now"
            return f"{device} may count otherwise: {text}"
        return ""

    def encoders_text(self, device: str) -> str:
        """Describe how a device counts, and how its joints are homed."""
        moduli_counts = self.identities[device].moduli_counts
        return encoders_text(self._model, device, moduli_counts)

    def is_exchanged(self, device: str) -> bool:
        """Return whether another device, or one of another arm, was confirmed."""
        known = self.confirmed(device)
        return known is not None and not (
            known.serials == self.identities[device].serials
            and self._is_of_this_arm(known)
        )

    def _is_of_this_arm(self, known: ConfirmedDevice) -> bool:
        return known.arm in {"", self.arm_text}

    @property
    def arm_text(self) -> str:
        """Name the arm whose file is used."""
        return arm_text(self._model)

    def is_recognised(self, device: str) -> bool:
        """Return whether an exchange of the confirmed device would be noticed."""
        boot, known = self.identities[device].boot, self.confirmed(device)
        identities = self.identities.items()
        is_boot_its_own = boot not in {of.boot for n, of in identities if n != device}
        has_its_power = (
            known is not None and bool(boot) and boot == known.boot and is_boot_its_own
        )
        is_known = self.is_unique(device) or has_its_power
        return is_known or device in self._assumed

    def is_unique(self, device: str) -> bool:
        """Return whether its serial numbers tell a device from any other."""
        identities = self.identities.items()
        other_serials = {
            s for name, of in identities if name != device for s in of.serials
        }
        serials = self.identities[device].serials
        is_whole = bool(serials) and all(serials) and len({*serials}) == len(serials)
        return is_whole and other_serials.isdisjoint(serials)

    @property
    def incremental_joints(self) -> tuple[str, ...]:
        """Joints, by name, whose encoders are not known to be absolute."""
        names = self._model.effects.joint_names
        return tuple(
            names[joint]
            for device in self.identities
            for joint in self.incremental_of(device)
        )

    def joints_of(self, device: str) -> list[int]:
        """Return the joints that a device reads, from 0."""
        return [j for j, d in enumerate(self._model.joint_devices) if d == device]

    def incremental_of(self, device: str) -> list[int]:
        """Return its joints whose encoders are not known to be absolute."""
        identity, joints = self.identities[device], self.joints_of(device)
        return [joint for joint in joints if not self._is_absolute(joint, identity)]

    def _is_absolute(self, joint: int, identity: Identity) -> bool | None:
        encoder = self._model.arm.joints[joint].encoder
        stated = None if encoder is None else encoder.absolute
        return identity.absolute if stated is None else stated
