"""Bytes of a latching controller board, after docs/serial-protocol.md.

The board's side only, written from the specification alone, so that a misreading of it
elsewhere cannot cancel.
"""

import binascii
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAJOR, MINOR = 1, 0
HELLO, CONFIGURE, START, STOP, LATCH, EDGE_ACK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
BOARD_TYPES = 0x80  # types from here on are the board's own
SAMPLE = 0x83
REQUEST_FIELDS = {
    HELLO: struct.Struct("<BBB"),
    CONFIGURE: struct.Struct("<BBHHI"),
    START: struct.Struct("<BI"),
    STOP: struct.Struct("<B"),
    LATCH: struct.Struct("<B"),
    EDGE_ACK: struct.Struct("<I"),
}
LONGEST_SEGMENT = 253
NO_SENSOR = -32768


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a board in HELLO.

    Attributes:
        bits: width of each channel's word.
        moduli: count at which each channel wraps, 1 to 2^32.
    """

    board_id: bytes
    firmware: tuple[int, int, int]
    n_inputs: int
    n_temperatures: int
    tick_rate_hz: int
    max_rate_millihz: int
    boot_id: int
    bits: tuple[int, ...]
    moduli: tuple[int, ...]


def frame(body: bytes) -> bytes:
    """Append the CRC, stuff zeros, end with the delimiter."""
    checked_body = body + binascii.crc_hqx(body, 0xFFFF).to_bytes(2, "little")
    parts = checked_body.split(b"\0")
    return b"".join([bytes((len(part) + 1,)) + part for part in parts]) + b"\0"


def body_of(segment: bytes) -> bytes | None:
    """Return the body of the bytes between two delimiters; None if it is broken."""
    body = bytearray()
    offset = 0
    while offset < len(segment):
        following = offset + segment[offset]
        if following > len(segment):
            return None
        body += segment[offset + 1 : following]
        if following < len(segment):
            body.append(0)
        offset = following
    if len(body) < 3:
        return None
    crc = binascii.crc_hqx(bytes(body[:-2]), 0xFFFF)
    return bytes(body[:-2]) if crc == int.from_bytes(body[-2:], "little") else None


class Segments:
    """Cuts received bytes at the delimiters; never holds more than one segment."""

    def __init__(self) -> None:
        self.n_too_long = 0
        self._kept = bytearray()
        self._overlong = False

    def feed(self, received: bytes) -> Iterator[bytes]:
        *ended, unended = received.split(b"\0")
        for part in ended:
            self._keep(part)
            segment, too_long = bytes(self._kept), self._overlong
            self.forget()
            if too_long:
                self.n_too_long += 1
            elif segment:
                yield segment
        self._keep(unended)

    def forget(self) -> None:
        self._kept.clear()
        self._overlong = False

    def _keep(self, part: bytes) -> None:
        if len(self._kept) + len(part) > LONGEST_SEGMENT:
            self._overlong = True
            self._kept.clear()
        elif not self._overlong:
            self._kept += part


def hello(request: int, identity: Identity) -> bytes:
    head = struct.pack(
        "<BBBB12s3BBBBIII",
        0x81,
        request,
        MAJOR,
        MINOR,
        identity.board_id,
        *identity.firmware,
        len(identity.moduli),
        identity.n_inputs,
        identity.n_temperatures,
        identity.tick_rate_hz,
        identity.max_rate_millihz,
        identity.boot_id,
    )
    channels = [
        struct.pack("<BI", bits, 0 if modulus == 2**bits == 2**32 else modulus)
        for bits, modulus in zip(identity.bits, identity.moduli, strict=True)
    ]
    return frame(head + b"".join(channels))


def reply(request_type: int, request: int, result: int, value: int) -> bytes:
    return frame(struct.pack("<BBBBI", 0x82, request_type, request, result, value))


def samples(
    cause: int,
    request: int,
    inputs: int,
    *,
    seqs: NDArray[np.uint32],
    ticks: NDArray[np.uint32],
    counts: NDArray[np.uint32],
    status: NDArray[np.uint8],
) -> list[bytes]:
    """Encode a run of latches during which no input changed.

    Args:
        cause: 0 the timed stream, 1 a LATCH.
        request: of the START or LATCH.
        inputs: bit i set if input i is active.
        seqs: (n,)
        ticks: (n,)
        counts: (n, n_channels)
        status: (n, n_channels)
    """
    n_channels = counts.shape[1]
    layout = np.dtype(
        [
            ("head", "u1", 4),
            ("seq", "<u4"),
            ("ticks", "<u4"),
            ("counts", "<u4", (n_channels,)),
            ("status", "u1", (n_channels,)),
        ]
    )
    block = np.empty(len(seqs), dtype=layout)
    block["head"] = (SAMPLE, cause, request, inputs)
    block["seq"], block["ticks"] = seqs, ticks
    block["counts"], block["status"] = counts, status
    size, bodies = layout.itemsize, block.tobytes()
    return [
        frame(bodies[start : start + size]) for start in range(0, len(bodies), size)
    ]


def edge(
    input_number: int,
    level: int,
    inputs: int,
    *,
    seq: int,
    ticks: int,
    counts: NDArray[np.uint32],
    status: NDArray[np.uint8],
) -> bytes:
    """Encode the change of an input with the counts (n_channels,) latched at it."""
    head = struct.pack("<BBBBII", 0x84, input_number, level, inputs, seq, ticks)
    return frame(head + counts.astype("<u4").tobytes() + status.tobytes())


def temperatures(ticks: int, values_c: Sequence[float | None]) -> bytes:
    hundredths = [NO_SENSOR if v is None else round(100.0 * v) for v in values_c]
    return frame(struct.pack(f"<BI{len(hundredths)}h", 0x85, ticks, *hundredths))


def alarm(
    channel: int, state: int, code: int, *, seq: int, ticks: int, value: int
) -> bytes:
    """Encode an alarm; channel 255 is the board itself."""
    return frame(struct.pack("<BBBHIIi", 0x86, channel, state, code, seq, ticks, value))


def heartbeat(
    state: int,
    inputs: int,
    ticks: int,
    *,
    edges_back: int,
    next_sample_seq: int,
    next_edge_seq: int,
    tx_dropped: int,
    rx_rejected: int,
) -> bytes:
    numbers = (ticks, next_sample_seq, next_edge_seq, tx_dropped, rx_rejected)
    wrapped = [number & 0xFFFFFFFF for number in numbers]
    return frame(struct.pack("<BBBB5I", 0x87, state, inputs, edges_back, *wrapped))
