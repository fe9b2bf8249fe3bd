"""What a driver delivers: frozen values, one for each thing that can happen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

STATUS_ERROR, STATUS_WARNING, STATUS_LATE, STATUS_STALE = 1, 2, 4, 8


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a device is and what it can do.

    Attributes:
        name: model and serial number, for people.
        moduli_counts: per channel, where its count wraps to 0.
        inputs: how many digital inputs it has.
        max_rate_hz: the fastest timed stream.
    """

    name: str
    firmware: str
    moduli_counts: tuple[int, ...]
    inputs: int
    max_rate_hz: float


@dataclass(frozen=True, slots=True, eq=False)
class CountSamples:
    """A block of timed samples, each latched at one instant.

    Attributes:
        device: id of the device in the configuration.
        stream: changes whenever ``seq`` starts again from 0.
        seq: (n,) int64, strictly increasing; a gap is a loss.
        device_ticks: (n,) int64, the device's counter, unwrapped.
        received_ns: host monotonic time right after the read.
        sample_time_ns: (n,) int64, host monotonic time of the latch.
        inputs: (n,) uint8, bit i set where input i is active.
        counts: (n, n_channels) uint32.
        status: (n, n_channels) uint8, bits ``STATUS_*``.
    """

    device: str
    stream: int
    seq: NDArray[np.int64]
    device_ticks: NDArray[np.int64]
    received_ns: int
    sample_time_ns: NDArray[np.int64]
    inputs: NDArray[np.uint8]
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]

    @classmethod
    def joined(cls, blocks: Sequence["CountSamples"]) -> "CountSamples":
        """Blocks of one stream that follow one another; received as the last."""
        if len(blocks) == 1:
            return blocks[0]
        return cls(
            blocks[-1].device,
            blocks[-1].stream,
            np.concatenate([block.seq for block in blocks]),
            np.concatenate([block.device_ticks for block in blocks]),
            blocks[-1].received_ns,
            np.concatenate([block.sample_time_ns for block in blocks]),
            np.concatenate([block.inputs for block in blocks]),
            np.concatenate([block.counts for block in blocks]),
            np.concatenate([block.status for block in blocks]),
        )


@dataclass(frozen=True, slots=True)
class LatchedCounts:
    """One sample taken at an input's edge or on request.

    Attributes:
        input: number of the input, or None where a request caused it.
        active: the new level of the input.
        token: what `Driver.request_latch` returned, or the edge's own number.
    """

    device: str
    input: int | None
    active: bool
    token: int
    device_ticks: int
    received_ns: int
    sample_time_ns: int
    counts: tuple[int, ...]
    status: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class StreamStarted:
    """A stream runs at ``rate_hz``; its samples carry ``stream``."""

    device: str
    stream: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class DeviceUp:
    """The device answered and is configured; ``restarted``: it had lost power."""

    device: str
    identity: Identity
    restarted: bool


@dataclass(frozen=True, slots=True)
class DeviceLost:
    """The device is gone; the driver keeps trying to get it back."""

    device: str
    reason: str
    remedy: str


@dataclass(frozen=True, slots=True)
class DeviceAlarm:
    """The device raised or cleared an alarm of its own."""

    device: str
    channel: int | None
    raised: bool
    code: int
    text: str
    value: int


@dataclass(frozen=True, slots=True)
class DeviceFault:
    """Something went wrong that the driver survived; see ``code``."""

    device: str
    code: str
    text: str
    remedy: str
    count: int = 1


@dataclass(frozen=True, slots=True)
class DeviceTemperatures:
    """Celsius by sensor; None where there is none."""

    device: str
    values_c: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class DeviceCounters:
    """Counters of a driver since its start, by name."""

    device: str
    values: Mapping[str, int] = field(default_factory=dict)


Delivery = (
    CountSamples
    | LatchedCounts
    | StreamStarted
    | DeviceUp
    | DeviceLost
    | DeviceAlarm
    | DeviceFault
    | DeviceTemperatures
    | DeviceCounters
)


class DeviceError(Exception):
    """A device did not behave; text says what was expected and what to do."""

    def __init__(self, text: str, remedy: str) -> None:
        super().__init__(text)
        self.remedy = remedy


class DeviceNotFoundError(DeviceError):
    """There is no such port, or it may not be opened: check cable and rights."""


class DeviceRefusedError(DeviceError):
    """The device is there and is not the one that was configured."""
