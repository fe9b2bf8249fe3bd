"""Packets of a MicroScribe (Immersion HCI), 8N1: one byte requests a packet.

    host -> arm    command, bit 7 clear
    arm -> host    command with bit 7 set
                   buttons, one bit each (right pedal 1, left pedal 2)
                   [timer, high and low 7 bits]
                   encoders, high and low 7 bits each

In a packet only the first byte has bit 7 set: after a lost byte the next packet is
found by it. There is no check sum, so that a spoilt byte can look like any other:
the reader must also check whether a count is plausible.

The bytes are those that several public programs agree on. Not confirmed by a maker's
document: that the arm ignores analog inputs when none are requested.
"""

from collections import Counter
from dataclasses import dataclass
from enum import Enum

N_BUTTONS = 7
TIMER_WRAP = 1 << 14
ENCODER_WRAP = 1 << 14

_MARK = 0x80
_TIMER, _ALL_ENCODERS = 0x20, 0x03


class Framing(Enum):
    """Versions of the protocol, by how many encoders the whole packet has."""

    HCI2 = 6
    HCI3 = 8

    @property
    def n_encoders(self) -> int:
        """Encoders of a packet, whether or not the arm has so many."""
        return self.value


def packet_request(*, timer: bool) -> bytes:
    """Request buttons and all encoders, optionally the timer."""
    return bytes([_ALL_ENCODERS | (_TIMER if timer else 0)])


def packet_size(framing: Framing, *, timer: bool) -> int:
    """How many bytes answer `packet_request`."""
    return 2 + 2 * timer + 2 * framing.n_encoders


@dataclass(frozen=True, slots=True)
class Packet:
    """The arm's state at one instant.

    Attributes:
        buttons: bit i set while button i is down.
        timer: the arm's timer, 0 to 16383; None where it was not requested.
        encoders: 0 to 16383 each.
    """

    buttons: int
    timer: int | None
    encoders: tuple[int, ...]


class PacketDecoder:
    """Finds packets in a stream of bytes; keeps less than one of them.

    Attributes:
        faults: other bytes, by name: "broken" packets that another one cut short,
            "foreign" ones without a request, "stray" bytes outside of packets.
    """

    def __init__(self, framing: Framing, *, timer: bool) -> None:
        self._first = packet_request(timer=timer)[0] | _MARK
        self._size = packet_size(framing, timer=timer)
        self._timer = timer
        self._begun = bytearray()
        self.accepted = 0
        self.faults: Counter[str] = Counter()

    @property
    def pending(self) -> bool:
        return bool(self._begun)

    def feed(self, data: bytes) -> list[Packet]:
        packets = []
        for byte in data:
            if byte & _MARK:
                self._begin(byte)
            elif self._begun:
                self._begun.append(byte)
            else:
                self.faults["stray"] += 1
            if len(self._begun) == self._size:
                packets.append(self._packet())
                self._begun.clear()
        self.accepted += len(packets)
        return packets

    def _begin(self, byte: int) -> None:
        if self._begun:
            self.faults["broken"] += 1
            self._begun.clear()
        if byte == self._first:
            self._begun.append(byte)
        else:
            self.faults["foreign"] += 1

    def _packet(self) -> Packet:
        words = [
            high << 7 | low
            for high, low in zip(self._begun[2::2], self._begun[3::2], strict=True)
        ]
        timer = words.pop(0) if self._timer else None
        return Packet(self._begun[1], timer, tuple(words))
