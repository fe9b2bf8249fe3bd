"""What has to be known of confirmed devices after a restart of the daemon."""

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from traverse.daemon.pose.arm_model import ArmModel


@dataclass(frozen=True, slots=True)
class ConfirmedDevice:
    """A device as the operator has confirmed it.

    Attributes:
        encoders: how the arm file described them, see `encoders_text`.
        serials: the numbers of the device, see `Identity`.
        boot: its power-up then; empty where it cannot tell.
        offsets_rad: by joint, what homing adds to its reading.
    """

    encoders: str
    serials: tuple[str, ...] = ()
    boot: str = ""
    offsets_rad: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """The device of plain values.

        Raises:
            ValueError: they are not of one.
            TypeError: the same.
            KeyError: the same.
        """
        offsets_rad = {str(j): float(a) for j, a in dict(values["offsets_rad"]).items()}
        serials = tuple(str(serial) for serial in values["serials"])
        return cls(str(values["encoders"]), serials, str(values["boot"]), offsets_rad)

    def to_values(self) -> dict[str, Any]:
        """As plain values."""
        return {**asdict(self), "serials": list(self.serials)}


class ReferenceMemory:
    """The devices that have been confirmed, for as long as the daemon runs.

    Args:
        devices: by id.
        is_lost: they were kept, and cannot be read.

    Attributes:
        devices, is_lost: as given.
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
        """These devices are confirmed."""
        self.devices |= devices

    @property
    def writing(self) -> "Future[None] | None":
        """What is done once the last addition is durable; None: it never will be."""
        return None


def encoders_text(model: ArmModel, device: str) -> str:
    """How an arm file describes the encoders of a device, to be compared."""
    encoders, names = model.encoders, model.effects.joint_names
    return ", ".join(
        f"{names[joint]}: channel {model.channels[joint]}, "
        f"{encoders.signs[joint] * encoders.counts_per_turn[joint]} counts"
        for joint, of in enumerate(model.joint_devices)
        if of == device
    )
