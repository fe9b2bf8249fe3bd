"""A MicroScribe's identification: sign-on, texts, greatest counts, its own geometry.

    sign-on      C5 "IMMC", again and again until "IMMC" comes back at that baud rate;
                 then "BEGIN", answered by the product's id and a NUL
    texts        C8 .. CE, each answered by itself and a text with a NUL behind it
    C6           greatest counts: buttons, timer, 8 analogs, their low bits, encoders
    C0           geometry: how many bytes, then ALPHA[6] A[6] D[6], big-endian
    C1           counts at the home position, 2 bytes each, big-endian
    CF           packets by themselves as soon as something has changed; 00 ends it

Geometry of format "DH0.5" is a table of Craig's (modified) rows: alpha in 1/32768 of a
half turn, a and d in 1/1000 inch. Encoders count up to their greatest count and then
continue at 0; a count is a turn by count / (greatest + 1).

Only generally known, not confirmed by a maker's document:
- with a comment that contains "Beta" the rotation about y at joint 3 stands behind the
  table, in the same reply, and turns the frame just before the joint's own turn;
- the 44 bytes of HCI3 after C6 hold eight greatest counts behind the first 12 bytes, of
  4 bytes each or of 2: the first is not zero, so that its place tells which;
- the home position has the order and size of the encoders.
"""

import math
import struct
from dataclasses import dataclass

from traverse.protocol.microscribe.packets import ENCODER_WRAP, Framing, packet_request

END_SESSION = b"\xc5"
CALL = b"IMMC"
BEGIN = b"BEGIN"
END_MOTION = b"\x00"
END_MOTION_REPLY = b"\x80"  # and the buttons

GEOMETRY, HOME, MAXES, MOTION = 0xC0, 0xC1, 0xC6, 0xCF
TEXTS = {
    "product": 0xC8,
    "id": 0xC9,
    "model": 0xCA,
    "serial": 0xCB,
    "comment": 0xCC,
    "format": 0xCD,
    "version": 0xCE,
}
DH_FORMAT = "Format DH0.5"
HOME_BYTES = 12
LONGEST_TEXT = 255

_MAXES_BYTES = {24: Framing.HCI2, 44: Framing.HCI3}
_TABLE = struct.Struct(">18h")
_EXTENSION = struct.Struct(">h")
_MM_PER_UNIT = 0.0254
_RAD_PER_UNIT = math.pi / 32768


@dataclass(frozen=True, slots=True)
class Maxes:
    """Greatest counts; 0 for an encoder that is not there."""

    framing: Framing
    timer: int
    encoders: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The arm's own table of modified rows.

    Attributes:
        alpha_rad: (6).
        a_mm: (6).
        d_mm: (6).
        beta_rad: rotation about y at joint 3, for arms that have one.
    """

    alpha_rad: tuple[float, ...]
    a_mm: tuple[float, ...]
    d_mm: tuple[float, ...]
    beta_rad: float = 0.0


def text_reply(command: int, data: bytes) -> str | None:
    """The text after its echo; None as long as something is missing."""
    body = _after_echo(command, data)
    end = -1 if body is None else body.find(0)
    return None if body is None or end < 0 else plain_text(body[:end])


def plain_text(data: bytes) -> str:
    text = data[:LONGEST_TEXT].decode("latin-1")
    return "".join(c for c in text if c.isprintable()).strip()


def counted_reply(command: int, data: bytes) -> bytes | None:
    """The block after its echo and size; None as long as something is missing."""
    body = _after_echo(command, data)
    if not body or len(body) < 1 + body[0]:
        return None
    return body[1 : 1 + body[0]]


def fixed_reply(command: int, size: int, data: bytes) -> bytes | None:
    """So many bytes after the echo; None as long as something is missing."""
    body = _after_echo(command, data)
    return None if body is None or len(body) < size else body[:size]


def maxes_reply(data: bytes) -> Maxes | None:
    """Greatest counts out of all received bytes; None if it is no such reply.

    Its size shows how packets are framed, so nothing may follow it.
    """
    body = _after_echo(MAXES, data)
    if body is None or len(body) not in _MAXES_BYTES:
        return None
    framing = _MAXES_BYTES[len(body)]
    n = framing.n_encoders
    (timer,) = struct.unpack_from(">H", body, 1)
    encoders: tuple[int, ...] = struct.unpack_from(f">{n}H", body, 12)
    if framing is Framing.HCI3 and not encoders[0]:
        encoders = struct.unpack_from(f">{n}I", body, 12)
    if not encoders[0] or max(encoders) >= ENCODER_WRAP:
        return None
    return Maxes(framing, timer, encoders)


def home_counts(block: bytes) -> tuple[int, ...]:
    return struct.unpack(">6H", block)


def kinematics_of(block: bytes, comment: str) -> Kinematics:
    """The arm's geometry.

    The block is the reply to `GEOMETRY` of an arm whose format is `DH_FORMAT`.

    Raises:
        ValueError: the block is of another size.
    """
    extended = "Beta" in comment
    expected = _TABLE.size + _EXTENSION.size * extended
    if len(block) < expected:
        raise ValueError(
            f"the geometry has {len(block)} bytes, expected {expected} "
            f"for comment {comment!r}"
        )
    values = _TABLE.unpack_from(block)
    beta = _EXTENSION.unpack_from(block, _TABLE.size)[0] if extended else 0
    return Kinematics(
        tuple(v * _RAD_PER_UNIT for v in values[:6]),
        tuple(v * _MM_PER_UNIT for v in values[6:12]),
        tuple(v * _MM_PER_UNIT for v in values[12:]),
        beta * _RAD_PER_UNIT,
    )


def motion_request(framing: Framing, delay_ms: int, *, timer: bool) -> bytes:
    """Request a packet whenever any button or any encoder has changed.

    The arm waits ``delay_ms`` between packets.
    """
    any_button, no_analogs = b"\x7f", bytes([0xFF] * 8)
    smallest_step = b"\x00\x01" * framing.n_encoders
    start = bytes([MOTION]) + struct.pack(">H", delay_ms)
    first_packet = packet_request(timer=timer)
    return start + first_packet + any_button + no_analogs + smallest_step


def _after_echo(command: int, data: bytes) -> bytes | None:
    start = data.find(command)
    return None if start < 0 else data[start + 1 :]
