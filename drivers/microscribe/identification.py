"""Identification of a MicroScribe, for the driver and the command line."""

from dataclasses import dataclass

from traverse.drivers.microscribe.line import MicroscribeLine
from traverse.protocol.microscribe.packets import TIMER_WRAP, Framing, PacketDecoder
from traverse.protocol.microscribe.session import Maxes


@dataclass(frozen=True, slots=True)
class MicroscribeIdentification:
    """Properties that an arm reports."""

    box: str
    product: str
    model: str
    serial: str
    version: str
    maxes: Maxes
    baud_rate: int

    @property
    def name(self) -> str:
        """For people: product, model and number."""
        words = [self.product or self.box or "MicroScribe", self.model, self.serial]
        return " ".join(filter(None, words))

    @property
    def framing(self) -> Framing:
        """Of its packets."""
        return self.maxes.framing

    @property
    def timer_wrap(self) -> int:
        """Where its timer returns to 0."""
        greatest = self.maxes.timer
        return greatest + 1 if 0 < greatest < TIMER_WRAP else TIMER_WRAP

    @property
    def moduli(self) -> tuple[int, ...]:
        """Counts a turn of the encoders that are there, from the base outwards."""
        there = [greatest + 1 for greatest in self.maxes.encoders]
        return tuple(there[: there.index(1)] if 1 in there else there)

    def decoder(self) -> PacketDecoder:
        """Of its packets with their timer."""
        return PacketDecoder(self.framing, timer=True)


def read_identification(
    line: MicroscribeLine, box: str, baud_rate: int
) -> MicroscribeIdentification:
    """Read the identity of an arm.

    Raises:
        DeviceError: it does not answer, or is no MicroScribe.
    """
    maxes = line.maxes()
    return MicroscribeIdentification(
        box=box,
        product=line.text("product"),
        model=line.text("model"),
        serial=line.text("serial"),
        version=line.text("version"),
        maxes=maxes,
        baud_rate=baud_rate,
    )
