"""Bytes of Same Sky (CUI) AMT21 encoders on an RS-485 line, 8N1, half duplex.

    host -> encoder    address + 0           position
                       address + 1           turns (multi-turn models)
                       address + 2, 5E       zero set (single-turn models only)
                       address + 2, 75       reset
    encoder -> host    low byte, high byte   K1 K0 and 14 bits of value

An address is any byte whose two low bits are 0, but not 00; 54 as delivered. K1 is
the odd parity of bits 13, 11 .. 1, K0 that of bits 12, 10 .. 0: a random word passes
one time in four, so that a reader must also check whether a value is plausible.
Models of 12 bits send their value times four. Two-wire adapters may echo a request.

The makers' sample code shows no reply to zero set and reset; that there is none, and
that nothing answers to a wrong address, is general knowledge and not confirmed.
"""

START_UP_S = 0.2  # after zero set, reset and power-up
VALUE_BITS = 14
REPLY_BYTES = 2

_VALUE_MASK = (1 << VALUE_BITS) - 1
_POSITION, _TURNS, _EXTENDED = 0, 1, 2
_ZERO, _RESET = 0x5E, 0x75


def is_address(number: int) -> bool:
    return 0 < number <= 0xFC and number % 4 == 0


def position_request(address: int) -> bytes:
    return _request(address, _POSITION)


def turns_request(address: int) -> bytes:
    """Request a multi-turn encoder's whole turns."""
    return _request(address, _TURNS)


def zero_request(address: int) -> bytes:
    """Make the present position of a single-turn encoder 0; the shaft must rest."""
    return _request(address, _EXTENDED, _ZERO)


def reset_request(address: int) -> bytes:
    """Restart an encoder, as after power-up."""
    return _request(address, _EXTENDED, _RESET)


def is_sound(word: int) -> bool:
    """Whether the check bits of a word of 16 bits fit its value."""
    pairs = word ^ word >> 8
    pairs ^= pairs >> 4
    pairs ^= pairs >> 2
    return pairs & 0b11 == 0b11


def turns_of(value: int) -> int:
    """Whole turns, signed, of the 14 bits that answered a turns request."""
    return value - (1 << VALUE_BITS) if value >> (VALUE_BITS - 1) else value


class Reply:
    """The reply to one request, fed as it arrives; stores at most 3 bytes.

    With ``echoed`` the adapter returns the request before it.

    Attributes:
        surplus: unexpected bytes beyond the reply.
    """

    def __init__(self, request: bytes, *, echoed: bool) -> None:
        self._echo = request if echoed else b""
        self._heard = b""
        self.surplus = 0

    @property
    def missing(self) -> int:
        return len(self._echo) + REPLY_BYTES - len(self._heard)

    @property
    def begun(self) -> bool:
        """Whether part of the reply itself has arrived, not only an echo."""
        return len(self._heard) > len(self._echo)

    @property
    def value(self) -> int | None:
        """The 14 bits of a whole and sound reply."""
        if self.missing or not self._heard.startswith(self._echo):
            return None
        word = int.from_bytes(self._heard[-REPLY_BYTES:], "little")
        return word & _VALUE_MASK if is_sound(word) else None

    def feed(self, data: bytes) -> bool:
        """Append bytes; return whether the reply is complete, sound or not."""
        accepted = data[: self.missing]
        self._heard += accepted
        self.surplus += len(data) - len(accepted)
        return self.missing == 0


def echo_heard(request: bytes, received: bytes) -> bool | None:
    """Return whether an adapter echoes, by all bytes after a request.

    None if that is unknown: nothing arrived, or noise.
    """
    if received == request:
        return True  # and no answer
    if received.startswith(request) and len(received) == len(request) + REPLY_BYTES:
        return (
            True
            if is_sound(int.from_bytes(received[-REPLY_BYTES:], "little"))
            else None
        )
    if len(received) == REPLY_BYTES and is_sound(int.from_bytes(received, "little")):
        return False
    return None


def _request(address: int, kind: int, *arguments: int) -> bytes:
    if not is_address(address):
        raise ValueError(
            f"{address:#04x} is no AMT21 address: expected a multiple of 4, "
            "from 0x04 to 0xFC"
        )
    return bytes((address + kind, *arguments))
