"""Frames and values of CANopen nodes with encoders (CiA 301, CiA 406).

A frame is an 11-bit identifier and up to eight bytes. `decode` turns what nodes send
into values; SDO transfers, which have a dialogue of their own, stay bytes here.
All numbers are little endian.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass

NMT, SYNC, LSS_ANSWER, LSS_REQUEST = 0x000, 0x080, 0x7E4, 0x7E5
EMCY, TPDO1, SDO_ANSWER, SDO_REQUEST, HEARTBEAT = 0x080, 0x180, 0x580, 0x600, 0x700
"""Identifiers; those of the second line plus the number of the node."""

FIRST_NODE, LAST_NODE = 1, 127

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 0x80, 0x81, 0x82
"""NMT commands."""

BOOT_UP, STATE_STOPPED, STATE_OPERATIONAL, STATE_PRE_OPERATIONAL = 0, 4, 5, 0x7F
"""States in a heartbeat; the first is sent once, after power-up or a reset."""

STATES = {
    BOOT_UP: "booting",
    STATE_STOPPED: "stopped",
    STATE_OPERATIONAL: "operational",
    STATE_PRE_OPERATIONAL: "pre-operational",
}

POSITION = struct.Struct("<I")
EMERGENCY = struct.Struct("<HB5s")


@dataclass(frozen=True, slots=True)
class Sync:
    """The instant at which all nodes latch; the counter only if requested."""

    counter: int | None


@dataclass(frozen=True, slots=True)
class Position:
    """Position that a node latched at the last SYNC (TPDO1, mapped to object 6004)."""

    node: int
    count: int


@dataclass(frozen=True, slots=True)
class Emergency:
    """An error of a node begins; with code 0 all its errors are over.

    Attributes:
        register: object 1001, which kinds of errors there are.
        detail: five bytes of the maker's own.
    """

    node: int
    code: int
    register: int
    detail: bytes


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """A node lives; ``state`` is one of `STATES`, or a number of the maker's own."""

    node: int
    state: int


@dataclass(frozen=True, slots=True)
class SdoAnswer:
    """Eight bytes of a transfer with a node."""

    node: int
    data: bytes


NodeMessage = Position | Emergency | Heartbeat | SdoAnswer
Message = Sync | NodeMessage


def decode(can_id: int, data: bytes | bytearray) -> Message | None:
    """Decode an encoder's frame; None for any other, or another length."""
    if can_id == SYNC:
        return Sync(data[0] if data else None) if len(data) <= 1 else None
    node, n = can_id & 0x7F, len(data)
    if node:
        match can_id - node:
            case 0x180 if n >= POSITION.size:
                return Position(node, POSITION.unpack_from(data)[0])
            case 0x080 if n == EMERGENCY.size:
                return Emergency(node, *EMERGENCY.unpack(data))
            case 0x700 if n == 1:
                return Heartbeat(node, data[0] & 0x7F)
            case 0x580 if n == 8:
                return SdoAnswer(node, bytes(data))
    return None


def identifiers(nodes: Iterable[int]) -> list[int]:
    services = (EMCY, TPDO1, SDO_ANSWER, HEARTBEAT)
    return [SYNC, *(service + node for node in nodes for service in services)]


def nmt_command(command: int, node: int) -> bytes:
    return bytes((command, node))


def frame_bits(n_bytes: int) -> int:
    """Return the longest time on the bus of a frame with ``n_bytes``, in bits.

    44 bits of frame, eight for each byte, 3 between frames; of the 34 + 8 n bits that
    are stuffed, one more after each four in the worst case.
    """
    stuffed = 34 + 8 * n_bytes
    return 44 + 8 * n_bytes + 3 + (stuffed - 1) // 4


def largest_sync_rate_hz(n_nodes: int, bit_rate: int) -> float:
    return bit_rate / (frame_bits(0) + n_nodes * frame_bits(POSITION.size))
