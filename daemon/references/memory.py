"""Memory of confirmed devices over a restart of the daemon."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from traverse.daemon.pose.arm_model import ArmModel


@dataclass(frozen=True, slots=True)
class ConfirmedDevice:
    """A device as the operator confirmed it.

    Attributes:
        encoders: their description, see `encoders_text`.
        serials: of the device, see `Identity`.
        boot: its power-up; empty if it cannot tell.
        firmware: of the device; empty if it does not say.
        offsets_rad: by joint, added to its reading by homing.
        arm: of which it was a part, see `arm_text`; empty if that was not kept.
    """

    encoders: str
    serials: tuple[str, ...] = ()
    boot: str = ""
    firmware: str = ""
    offsets_rad: Mapping[str, float] = field(default_factory=dict)
    arm: str = ""

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """Read a device from plain values.

        Raises:
            ValueError, TypeError, KeyError: they are not of one.
        """
        offsets_rad = {str(j): float(a) for j, a in dict(values["offsets_rad"]).items()}
        serials = tuple(str(serial) for serial in values["serials"])
        encoders, boot = str(values["encoders"]), str(values["boot"])
        firmware, arm = str(values["firmware"]), str(values.get("arm", ""))
        return cls(encoders, serials, boot, firmware, offsets_rad, arm)

    def to_values(self) -> dict[str, Any]:
        return {**asdict(self), "serials": list(self.serials)}


class ReferenceMemory:
    """Confirmed devices, for as long as the daemon runs.

    Args:
        is_lost: the stored ones cannot be read.
    """

    def __init__(
        self,
        devices: Mapping[str, ConfirmedDevice] | None = None,
        *,
        is_lost: bool = False,
    ) -> None:
        self.devices = dict(devices or {})
        self.is_lost = is_lost

    def add(self, devices: Mapping[str, ConfirmedDevice]) -> None:
        self.devices |= devices

    @property
    def writing(self) -> "Future[None] | None":
        """The last addition's write; None if it is not stored."""
        return None


def arm_text(model: ArmModel) -> str:
    """Name the arm of an arm file; another one's geometry does not fit its devices."""
    number = model.arm.serial_number
    return f"{model.arm.name}, serial number {number}" if number else model.arm.name


def encoders_text(model: ArmModel, device: str, moduli_counts: Sequence[int]) -> str:
    """Describe a device's encoders, and where they are homed, for comparison.

    Several turns are as the device reports.
    """
    encoders, names = model.encoders, model.effects.joint_names
    homes_rad = {} if model.arm.home is None else model.arm.home.angles_rad
    texts = []
    for joint, of in enumerate(model.joint_devices):
        if of != device:
            continue
        channel, turn = model.channels[joint], encoders.counts_per_turn[joint]
        counts = encoders.signs[joint] * turn
        text = f"{names[joint]}: channel {channel}, {counts} counts"
        if channel < len(moduli_counts) and moduli_counts[channel] != turn:
            text += f" of {moduli_counts[channel]}"
        if names[joint] in homes_rad:
            text += f", home {homes_rad[names[joint]]!r} rad"
        texts.append(text)
    return ", ".join(texts)
