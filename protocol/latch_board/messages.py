"""Messages of a latching board, as values; numbers of docs/serial-protocol.md."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        request: that of the START which began the stream.
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
    """Sign of life, with what the next sample and edge will be numbered.

    Attributes:
        edges_back: so many numbers before ``next_edge_seq`` is the oldest edge that
            waits to be acknowledged; 0 where none waits.
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
