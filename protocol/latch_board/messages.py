"""Messages of a latching board, as values."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Channel:
    """One encoder as the board describes it; counts run from 0 to modulus - 1."""

    bits: int
    modulus: int


@dataclass(frozen=True, slots=True)
class Hello:
    """Who the board is and what it has."""

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
