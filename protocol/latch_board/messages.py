"""Messages of a latching board: requests to bytes, bodies of frames to values.

Numbers and layouts are from docs/serial-protocol.md, sections 3 and 4. A parser
returns None where the length is wrong. Bodies of timed samples that follow one another
become one block.
"""

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.protocol.latch_board.framing import FrameSplitter, encode_frame

MAJOR = 1
FORGET_EDGES = 1  # flag of HELLO

HELLO, CONFIGURE, START, STOP, LATCH, EDGE_ACK = 1, 2, 3, 4, 5, 6
EDGE = 0x84
REQUEST_NAMES = {1: "HELLO", 2: "CONFIGURE", 3: "START", 4: "STOP", 5: "LATCH"}
RESULTS = {
    0: "done",
    1: "request not known",
    2: "wrong length",
    3: "rate out of range",
    4: "protocol version not supported",
    5: "value out of range",
    6: "not possible before HELLO",
}
STATUS_ERROR, STATUS_WARNING, STATUS_LATE, STATUS_STALE = 1, 2, 4, 8
ALARMS = {
    1: "encoder signal weak",
    2: "encoder error, count not valid",
    3: "encoder turned faster than it can follow",
    4: "supply voltage out of range",
    5: "board temperature out of range",
    6: "frames dropped, the line is too slow",
    7: "edges lost, not acknowledged in time",
    8: "encoder does not answer",
}
WHOLE_BOARD = 0xFF  # channel of an alarm
NO_SENSOR = -32768


@dataclass(frozen=True, slots=True)
class Channel:
    """One encoder as the board describes it; counts run from 0 to modulus - 1."""

    bits: int
    modulus: int


@dataclass(frozen=True, slots=True)
class Hello:
    """Identity of the board, its channels and inputs."""

    request: int
    version: tuple[int, int]
    board_id: bytes
    firmware: tuple[int, int, int]
    n_inputs: int
    n_temperatures: int
    tick_rate_hz: int
    max_rate_hz: float
    boot_id: int
    channels: tuple[Channel, ...]


@dataclass(frozen=True, slots=True)
class Reply:
    """The board's answer to a request."""

    request_type: int
    request: int
    result: int
    value: int


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """Timed samples of one stream, in the order received.

    Attributes:
        request: of the START which began the stream.
        seq: (n,) uint32, ticks: (n,) uint32 at the latch, inputs: (n,) uint8 bits,
        counts: (n, n_channels) uint32, status: (n, n_channels) uint8 bits.
    """

    request: int
    seq: NDArray[np.uint32]
    ticks: NDArray[np.uint32]
    inputs: NDArray[np.uint8]
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Latched:
    """One sample latched on request."""

    request: int
    inputs: int
    ticks: int
    counts: tuple[int, ...]
    status: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Edge:
    """A change of an input with the counts latched at that instant."""

    input: int
    level: int
    inputs: int
    seq: int
    ticks: int
    counts: tuple[int, ...]
    status: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Temperatures:
    """Celsius by sensor; None where there is none."""

    ticks: int
    values_c: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm raised or cleared by the board."""

    channel: int
    raised: bool
    code: int
    seq: int
    ticks: int
    value: int


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Sign of life, with the next numbers of samples and edges.

    Attributes:
        edges_back: ``next_edge_seq`` minus the number of the oldest unacknowledged
            edge; 0 for none.
    """

    streaming: bool
    inputs: int
    edges_back: int
    ticks: int
    next_sample_seq: int
    next_edge_seq: int
    tx_dropped: int
    rx_rejected: int


Message = (
    Hello | Reply | SampleBlock | Latched | Edge | Temperatures | Alarm | Heartbeat
)

TIMED = b"\x02\x83"
"""How the frame of a timed sample begins, and no other: its type, then a token of 0."""


def _sample_dtype(n_channels: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("head", "u1", (3,)),
            ("inputs", "u1"),
            ("seq", "<u4"),
            ("ticks", "<u4"),
            ("counts", "<u4", (n_channels,)),
            ("status", "u1", (n_channels,)),
        ]
    )


_SAMPLE_DTYPES = {n: _sample_dtype(n) for n in range(1, 48)}


def sample_block(bodies: list[bytes]) -> SampleBlock:
    """Decode bodies of one stream and one length as a block."""
    rows = np.frombuffer(b"".join(bodies), _SAMPLE_DTYPES[(len(bodies[0]) - 12) // 5])
    return SampleBlock(
        bodies[0][2],
        rows["seq"],
        rows["ticks"],
        rows["inputs"],
        rows["counts"],
        rows["status"],
    )


_HELLO = struct.Struct("<BBBB12s3sBBBIII")  # type request major minor id firmware ...
_CHANNEL = struct.Struct("<BI")  # bits modulus
_REPLY = struct.Struct("<BBBBI")  # type request_type request result value
_LATCHED = struct.Struct("<BBBBII")  # type, three bytes, seq ticks; counts, status
_ALARM = struct.Struct("<BBBHIIi")  # type channel state code seq ticks value
_HEARTBEAT = struct.Struct("<BBBBIIIII")


def _parse_hello(body: bytes) -> Hello | None:
    if len(body) < _HELLO.size:
        return None
    _, request, major, minor, board_id, firmware, n_channels, *properties = (
        _HELLO.unpack_from(body)
    )
    n_inputs, n_temperatures, tick_rate_hz, max_rate, boot_id = properties
    described = body[_HELLO.size :]
    if len(described) != n_channels * _CHANNEL.size:
        return None
    channels = tuple(
        Channel(bits, modulus or 1 << bits)
        for bits, modulus in _CHANNEL.iter_unpack(described)
    )
    return Hello(
        request,
        (major, minor),
        board_id,
        (firmware[0], firmware[1], firmware[2]),
        n_inputs,
        n_temperatures,
        tick_rate_hz,
        max_rate / 1000,
        boot_id,
        channels,
    )


def _parse_reply(body: bytes) -> Reply | None:
    return Reply(*_REPLY.unpack(body)[1:]) if len(body) == _REPLY.size else None


def _latch(body: bytes) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    n_channels, left = divmod(len(body) - _LATCHED.size, 5)
    if n_channels < 0 or left:
        return None
    counts = struct.unpack_from(f"<{n_channels}I", body, _LATCHED.size)
    return counts, tuple(body[len(body) - n_channels :])


def _parse_latched(body: bytes) -> Latched | None:
    values = _latch(body)
    if values is None:
        return None
    _, _, request, inputs, _, ticks = _LATCHED.unpack_from(body)
    return Latched(request, inputs, ticks, *values)


def _parse_edge(body: bytes) -> Edge | None:
    values = _latch(body)
    if values is None:
        return None
    _, number, level, inputs, seq, ticks = _LATCHED.unpack_from(body)
    return Edge(number, level, inputs, seq, ticks, *values)


def _parse_temperatures(body: bytes) -> Temperatures | None:
    count, left = divmod(len(body) - 5, 2)
    if count < 0 or left:
        return None
    ticks, *raw = struct.unpack(f"<I{count}h", body[1:])
    return Temperatures(ticks, tuple(None if v == NO_SENSOR else v / 100 for v in raw))


def _parse_alarm(body: bytes) -> Alarm | None:
    if len(body) != _ALARM.size:
        return None
    _, channel, state, code, seq, ticks, value = _ALARM.unpack(body)
    return Alarm(channel, state != 0, code, seq, ticks, value)


def _parse_heartbeat(body: bytes) -> Heartbeat | None:
    if len(body) != _HEARTBEAT.size:
        return None
    _, state, inputs, back, *counters = _HEARTBEAT.unpack(body)
    return Heartbeat(state == 1, inputs, back, *counters)


PARSERS: dict[int, Callable[[bytes], Message | None]] = {
    0x81: _parse_hello,
    0x82: _parse_reply,
    0x83: _parse_latched,
    EDGE: _parse_edge,
    0x85: _parse_temperatures,
    0x86: _parse_alarm,
    0x87: _parse_heartbeat,
}


class Decoder:
    """Decodes bytes of a board; faults are counted, never raised."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter()

    @property
    def faults(self) -> Counter[str]:
        """Frames dropped so far, by reason."""
        return self._splitter.faults

    @property
    def accepted(self) -> int:
        """Frames that were valid as frames, unknown types included."""
        return self._splitter.accepted

    @property
    def pending(self) -> int:
        return self._splitter.pending

    def feed(self, data: bytes) -> list[Message]:
        """Return messages completed by ``data``, in the order of the bytes."""
        messages: list[Message] = []
        run: list[bytes] = []
        for body in self._splitter.feed(data):
            if body[0] == 0x83 and len(body) >= 17 and body[1] == 0:
                if run and (len(body) != len(run[0]) or body[2] != run[0][2]):
                    messages.append(sample_block(run))
                    run = []
                if (len(body) - 12) % 5:
                    self.faults["bad_length"] += 1
                else:
                    run.append(body)
                continue
            if run:
                messages.append(sample_block(run))
                run = []
            message = self._decode(body)
            if message is not None:
                messages.append(message)
        if run:
            messages.append(sample_block(run))
        return messages

    def _decode(self, body: bytes) -> Message | None:
        parse = PARSERS.get(body[0])
        if parse is None:
            self.faults["unknown_type"] += 1
            return None
        message = parse(body)
        if message is None:
            self.faults["bad_length"] += 1
        return message


def hello_request(request: int, flags: int = 0) -> bytes:
    """Request the identity; with `FORGET_EDGES`, drop edges not yet acknowledged."""
    return encode_frame(bytes((HELLO, request, MAJOR, flags)))


def configure_request(
    request: int,
    edge_mask: int,
    heartbeat_ms: int,
    temperature_ms: int,
    debounce_us: int,
) -> bytes:
    """Set which inputs report edges, how often the board reports, the debouncing."""
    fields = (request, edge_mask, heartbeat_ms, temperature_ms, debounce_us)
    return encode_frame(struct.pack("<BBBHHI", CONFIGURE, *fields))


def start_request(request: int, rate_millihz: int) -> bytes:
    return encode_frame(struct.pack("<BBI", START, request, rate_millihz))


def stop_request(request: int) -> bytes:
    return encode_frame(bytes((STOP, request)))


def latch_request(request: int) -> bytes:
    return encode_frame(bytes((LATCH, request)))


def edge_ack(seq: int) -> bytes:
    return encode_frame(struct.pack("<BI", EDGE_ACK, seq))
