"""Bytes of RLS Orbis and AksIM encoders on an asynchronous serial line, 8N1.

    asked by host   answered
    31 '1'          31 P          position
    33 '3'          P             position, short
    64 'd'          64 P D        position and detailed status
    74 't'          74 P T        position and temperature
    76 'v'          76 + 6        serial number, in ASCII
    69 'i'          69 S          state of the self-calibration

P is big-endian: with multi-turn encoders the turns as 16 bits, signed; then the
position from the highest bit down, 2 bytes up to 14 bits and 3 bytes above, its two
lowest bits error and warning, which are 0 when there is something to report. D has its
bits set when there is; T is signed, in tenths of a degree Celsius. There is no check
sum: a header and the bits that must be 0 are all that identifies a reply.

Settings are sent after the four bytes of `UNLOCK`, a millisecond or more between two
bytes, each of which is echoed: `STOP` and `START` of the continuous mode, in which the
encoder repeats one answer by itself, and `continuous`, which states
which request and how often.

The bytes of commands and replies rest on three independent implementations and on
data sheets as they quote them. That bits between position and status are 0, and that a
reply states the position at the arrival of its request, is general knowledge and not
confirmed by the makers' documents.
"""

from dataclasses import dataclass

POSITION, SHORT, DETAILED, TEMPERATURE = b"1", b"3", b"d", b"t"
SERIAL_NUMBER, CALIBRATION = b"v", b"i"
UNLOCK = bytes.fromhex("CD EF 89 AB")
START, STOP = b"S", b"P"
LEAST_BITS, MOST_BITS = 10, 22
TURNS_BITS = 16
SERIAL_BYTES = 6
CONDITIONS = {
    0x80: "signal_too_high",
    0x40: "signal_too_low",
    0x20: "temperature_out_of_range",
    0x10: "speed_too_high",
    0x08: "turns_counter_error",
}
"""Bits of the detailed status; the lowest three have no meaning that is known."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How an encoder writes its position."""

    bits: int
    turns: bool = False

    def __post_init__(self) -> None:
        if not LEAST_BITS <= self.bits <= MOST_BITS:
            raise ValueError(f"{self.bits} bits; expected {LEAST_BITS} to {MOST_BITS}")

    @property
    def word_bytes(self) -> int:
        return 2 if self.bits <= 14 else 3

    @property
    def position_bytes(self) -> int:
        return self.word_bytes + 2 * self.turns

    def reply_bytes(self, request: bytes) -> int:
        """Length of the reply to a request.

        Raises:
            ValueError: It is no request of this protocol.
        """
        lengths = {
            POSITION: 1 + self.position_bytes,
            SHORT: self.position_bytes,
            DETAILED: 2 + self.position_bytes,
            TEMPERATURE: 3 + self.position_bytes,
            SERIAL_NUMBER: 1 + SERIAL_BYTES,
            CALIBRATION: 2,
        }
        if request not in lengths:
            raise ValueError(f"{request!r} is no request; expected one of {lengths}")
        return lengths[request]


@dataclass(frozen=True, slots=True)
class Position:
    """The contents of a reply with a position.

    Attributes:
        turns: Whole turns, signed; 0 without a counter of turns.
        error: The position is not valid.
        warning: It is, but nearly not.
        conditions: Bits of `CONDITIONS`; None where the reply has none.
        temperature_c: Of the encoder; None where the reply has none.
    """

    count: int
    turns: int
    error: bool
    warning: bool
    conditions: int | None = None
    temperature_c: float | None = None


def position(reply: bytes, request: bytes, layout: Layout) -> Position | None:
    """Read a whole reply; None where it cannot be one."""
    head = b"" if request == SHORT else request
    if len(reply) != layout.reply_bytes(request) or not reply.startswith(head):
        return None
    offset = len(head) + 2 * layout.turns
    turns = (
        int.from_bytes(reply[offset - 2 : offset], "big", signed=True)
        if layout.turns
        else 0
    )
    word = int.from_bytes(reply[offset : offset + layout.word_bytes], "big")
    unused = 8 * layout.word_bytes - layout.bits
    if word & (1 << unused) - 4:
        return None
    trailer = reply[offset + layout.word_bytes :]
    return Position(
        word >> unused,
        turns,
        error=not word & 2,
        warning=not word & 1,
        conditions=trailer[0] if request == DETAILED else None,
        temperature_c=int.from_bytes(trailer, "big", signed=True) / 10.0
        if request == TEMPERATURE
        else None,
    )


def serial_number(reply: bytes) -> str | None:
    """Read the reply to `SERIAL_NUMBER`; None where it cannot be one."""
    text = reply[1:]
    sound = reply.startswith(SERIAL_NUMBER) and len(text) == SERIAL_BYTES
    printable = all(0x20 < byte < 0x7F for byte in text)
    return text.decode("ascii") if sound and printable else None


def continuous(request: bytes, period_us: int, *, autostart: bool = False) -> bytes:
    """Settings of the continuous mode, to be sent after `UNLOCK`."""
    return b"T" + bytes((autostart,)) + request + period_us.to_bytes(2, "big")


class Replies:
    """Unsolicited replies, cut out of the bytes by their headers.

    A header may also occur inside a reply. So after anything that does not fit, two
    replies in a row are required before one is valid, and the third header after them.

    The request is one whose reply has a header.

    Attributes:
        skipped: Bytes that were no part of a reply.
    """

    def __init__(self, request: bytes, layout: Layout) -> None:
        if request == SHORT:
            raise ValueError("a short reply has no header to be found by")
        self.skipped = 0
        self._request = request
        self._layout = layout
        self._size = layout.reply_bytes(request)
        self._kept = b""
        self._in_step = False

    def feed(self, data: bytes) -> list[Position]:
        kept = self._kept + data
        positions: list[Position] = []
        offset = 0
        while len(kept) - offset >= self._size:
            found_position = self._position(kept, offset)
            if found_position is not None and not self._in_step:
                if len(kept) - offset <= 2 * self._size:
                    break  # the rest has yet to arrive
                self._in_step = (
                    self._position(kept, offset + self._size) is not None
                    and kept[offset + 2 * self._size] == self._request[0]
                )
            if found_position is not None and self._in_step:
                positions.append(found_position)
                offset += self._size
            else:
                self._in_step = False
                self.skipped += 1
                offset += 1
        self._kept = kept[offset:]
        return positions

    def _position(self, data: bytes, offset: int) -> Position | None:
        return position(data[offset : offset + self._size], self._request, self._layout)
