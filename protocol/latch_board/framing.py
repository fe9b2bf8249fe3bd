"""COBS frames with a CRC: the line discipline of docs/serial-protocol.md, section 1.

A frame is ``COBS(body || crc) || 00``. `FrameSplitter` is fed with the bytes of each
read; its output and its counters depend on the bytes only, never on how they were cut
into reads. It keeps at most one frame between reads.
"""

from binascii import crc_hqx
from collections import Counter

from cobs import cobs

MAX_BODY = 250
MAX_SEGMENT = MAX_BODY + 3  # crc and the one byte that COBS adds

CRC_START = 0xFFFF  # CRC-16/IBM-3740

FAULTS = ("too_long", "bad_cobs", "too_short", "bad_crc", "bad_length", "unknown_type")


def encode_frame(body: bytes) -> bytes:
    """The frame, delimiter included, that carries ``body`` (1 to 250 bytes).

    Raises:
        ValueError: the body is empty or longer than 250 bytes.
    """
    if not 1 <= len(body) <= MAX_BODY:
        raise ValueError(f"a frame's body has 1 to {MAX_BODY} bytes, not {len(body)}")
    crc = crc_hqx(body, CRC_START).to_bytes(2, "little")
    return bytes(cobs.encode(body + crc)) + b"\0"


class FrameSplitter:
    """Cuts a stream of bytes into the bodies of its valid frames.

    Attributes:
        faults: dropped frames and bytes, by reason (`FAULTS`); a frame counts once.
        accepted: how many frames were valid.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        self.accepted = 0
        self._rest = b""
        self._overlong = False

    @property
    def pending(self) -> int:
        """Bytes of an unfinished frame kept for the next `feed`; never over 253."""
        return len(self._rest)

    def feed(self, data: bytes) -> list[bytes]:
        """Bodies of the frames that ``data`` completes, in order."""
        segments = (self._rest + data).split(b"\0")
        self._rest = segments.pop()
        if self._overlong and segments:
            segments[0] = b""  # the tail of what was counted as too long already
            self._overlong = False
        bodies = [body for segment in segments if (body := self._open(segment))]
        if self._overlong:
            self._rest = b""
        elif len(self._rest) > MAX_SEGMENT:
            self.faults["too_long"] += 1
            self._overlong = True
            self._rest = b""
        self.accepted += len(bodies)
        return bodies

    def _open(self, segment: bytes) -> bytes | None:
        if not segment:
            return None
        if len(segment) > MAX_SEGMENT:
            self.faults["too_long"] += 1
            return None
        try:
            content = cobs.decode(segment)
        except cobs.DecodeError:
            self.faults["bad_cobs"] += 1
            return None
        if len(content) < 3:
            self.faults["too_short"] += 1
            return None
        body = bytes(content[:-2])
        if crc_hqx(body, CRC_START) != content[-2] | content[-1] << 8:
            self.faults["bad_crc"] += 1
            return None
        return body
