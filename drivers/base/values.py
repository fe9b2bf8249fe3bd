"""Deliveries of a driver: one frozen class for each kind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers

STATUS_ERROR, STATUS_WARNING, STATUS_LATE, STATUS_STALE = 1, 2, 4, 8
STATUS_MISSING, STATUS_INTERPOLATED, STATUS_TIME_UNCERTAIN = 16, 32, 64
"""Bits of a channel's status; missing: no answer, the count is the last known one.

A driver does not set `STATUS_INTERPOLATED`, nor any bit that is not listed here.
"""

NOT_READ = STATUS_ERROR | STATUS_MISSING | STATUS_STALE
"""Bits of a count that was not read at its time."""


def are_valid(status: NDArray[np.uint8]) -> Booleans:
    return np.asarray((status & (STATUS_ERROR | STATUS_MISSING)) == 0)


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity and abilities of a device.

    Attributes:
        name: model and serial number, for people.
        moduli_counts: by channel, where its count wraps to 0.
        max_rate_hz: the fastest timed stream; 0 for none.
        latches: it latches all channels at one instant, at its edges and on request;
            otherwise points are interpolated.
        counts_per_turn: by channel, as the device reports; None or left out if it
            does not. It must agree with the arm file.
        jitter_ns: error of the instant of a reading, as the driver states; of a device
            that latches also the time from an edge to its latch.
        absolute: its counts are right again after a loss of power; None: that depends
            on unknown encoders.
        boot: changes with each loss of power; empty if unknown.
        serials: unique numbers by channel, or one for all; empty texts where not
            reported.
        steps_counts: by channel, by how many counts readings differ at least, where
            the device's words have fewer digits than the counts that are made of them.
        reads_in_turn: it reads one channel after the other, so that counts at one
            instant are interpolated at any rate.
    """

    name: str
    firmware: str
    moduli_counts: tuple[int, ...]
    inputs: int
    max_rate_hz: float
    latches: bool = True
    counts_per_turn: tuple[int | None, ...] = ()
    jitter_ns: int = 0
    absolute: bool | None = None
    boot: str = ""
    serials: tuple[str, ...] = ()
    steps_counts: tuple[float, ...] = ()
    reads_in_turn: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CountSamples:
    """A block of timed samples.

    Attributes:
        device: id of the device in the configuration.
        stream: changes whenever ``seq`` starts again from 0.
        seq: (n,) int64, strictly increasing; a gap is a loss.
        device_ticks: (n,) int64, the device's counter, unwrapped.
        received_ns: host monotonic time right after the read.
        sample_time_ns: (n,) int64, host monotonic time of the latch.
        inputs: (n,) uint8, bit i set if input i is active.
        counts: (n, n_channels) uint32.
        status: (n, n_channels) uint8, bits ``STATUS_*``.
        skew_ns: (n, n_channels) int32, time of each channel's reading after
            ``sample_time_ns``; None if all were latched at that instant.
        fractions: (n, n_channels), to be added to ``counts``; None for 0. Only
            interpolated samples have them.
        skew_bound_ns: (n, n_channels) int32, error of each channel's time; None, or
            0: the block's.
        time_bound_ns: error of the times by the present state of the device's clock;
            0: as `Identity.jitter_ns` states.
    """

    device: str
    stream: int
    seq: Integers
    device_ticks: Integers
    received_ns: int
    sample_time_ns: Integers
    inputs: NDArray[np.uint8]
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]
    skew_ns: NDArray[np.int32] | None = None
    fractions: Floats | None = None
    skew_bound_ns: NDArray[np.int32] | None = None
    time_bound_ns: int = 0

    @classmethod
    def joined(cls, blocks: Sequence["CountSamples"]) -> "CountSamples":
        """Concatenate successive blocks of one stream, received as the last."""
        if len(blocks) == 1:
            return blocks[0]
        last = blocks[-1]
        arrays: list[Any] = [
            None if column[0] is None else np.concatenate(column)
            for column in zip(*map(_arrays, blocks), strict=True)
        ]
        seq, ticks, *columns = arrays
        bound_ns = max(block.time_bound_ns for block in blocks)
        joined = cls(last.device, last.stream, seq, ticks, last.received_ns, *columns)
        return replace(joined, time_bound_ns=bound_ns) if bound_ns else joined

    def rows(self, selection: slice | Booleans) -> "CountSamples":
        arrays: list[Any] = [None if a is None else a[selection] for a in _arrays(self)]
        seq, ticks, *columns = arrays
        chosen = CountSamples(
            self.device, self.stream, seq, ticks, self.received_ns, *columns
        )
        bound_ns = self.time_bound_ns
        return replace(chosen, time_bound_ns=bound_ns) if bound_ns else chosen


_arrays = attrgetter(
    *("seq", "device_ticks", "sample_time_ns", "inputs"),
    *("counts", "status", "skew_ns", "fractions", "skew_bound_ns"),
)


@dataclass(frozen=True, slots=True)
class PolledSample:
    """Counts of all channels, read one after the other or in one packet.

    Attributes:
        ticks: the device's timer, unwrapped; the time again if it has none.
        status: by channel, bits ``STATUS_*``; if missing, the last count is repeated.
        skew_ns: by channel, from ``time_ns`` to its reading; None: all at one instant.
        skew_bound_ns: by channel, error of that time; None, or 0: of the sample's.
        time_bound_ns: error of ``time_ns``; 0: as the identity states.
    """

    time_ns: int
    received_ns: int
    ticks: int
    inputs: int
    counts: tuple[int, ...]
    status: tuple[int, ...]
    skew_ns: tuple[int, ...] | None = None
    skew_bound_ns: tuple[int, ...] | None = None
    time_bound_ns: int = 0

    @property
    def complete(self) -> bool:
        return not any(self.status)


@dataclass(frozen=True, slots=True)
class LatchedCounts:
    """An input's edge, or one sample taken on request.

    Attributes:
        input: number of the input, or None for a request.
        active: the new level of the input.
        token: of `Driver.request_latch`, or the edge's own number.
        counts: of all channels, latched at ``sample_time_ns``; empty for a device that
            has none, or cannot latch them (see `Identity.latches`).
        status: of each channel, bits ``STATUS_*``; as long as ``counts``.
        time_bound_ns: error of ``sample_time_ns``; 0: as the identity states.
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
    time_bound_ns: int = 0


@dataclass(frozen=True, slots=True)
class StreamStarted:
    """A stream runs at ``rate_hz``; its samples carry ``stream``.

    Attributes:
        requested_hz: the requested rate if the device cannot stream at it; else 0.
        reached_hz: the fastest rate of the device now; 0: that of its identity.
    """

    device: str
    stream: int
    rate_hz: float
    requested_hz: float = 0.0
    reached_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class DeviceUp:
    """The device answered and is configured; ``restarted``: it had lost power.

    Attributes:
        active_inputs: bit i set if input i is active; None if samples or edges show it.
    """

    device: str
    identity: Identity
    restarted: bool
    active_inputs: int | None = None


@dataclass(frozen=True, slots=True)
class DeviceLost:
    """The device is lost; the driver keeps trying to reconnect.

    Attributes:
        since_ns: readings after this host monotonic time may be wrong already; 0: none.
    """

    device: str
    reason: str
    remedy: str
    since_ns: int = 0


@dataclass(frozen=True, slots=True)
class DeviceAlarm:
    """A condition of the device begins (``raised``) or ends.

    Attributes:
        channel: concerned; None for the whole device.
        code: letters, digits and ``_``; its event is ``alarm.<code>``.
        value: the device's value with it, 0 for none.
        remedy: what to do about it.
    """

    device: str
    channel: int | None
    raised: bool
    code: int | str
    text: str
    value: int
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class DeviceFault:
    """A fault that the driver survived; see ``code``."""

    device: str
    code: str
    text: str
    remedy: str
    count: int = 1


@dataclass(frozen=True, slots=True)
class RepeatedCount:
    """Some readings of a moving joint have repeated the count before them.

    Attributes:
        n_readings: that are old.
        off_rad: by how much the first of them is.
        since_ns: time of the last new reading before.
        until_ns: time of the first new one after.
        is_clear: no hand stops a joint and brings it back so; else it may be chance,
            unless there is another one.
        period_ns: between readings; only some of them may be samples.
    """

    device: str
    channel: int
    n_readings: int
    off_rad: float
    since_ns: int
    until_ns: int
    is_clear: bool
    period_ns: int


@dataclass(frozen=True, slots=True)
class DeviceTemperatures:
    """Temperatures in Celsius by sensor; None where there is none.

    Attributes:
        period_ns: each sensor is reported so often; 0: at any time.
    """

    device: str
    values_c: tuple[float | None, ...]
    period_ns: int = 0


@dataclass(frozen=True, slots=True)
class DeviceClockState:
    """State of the device's clock, reported at first and on changes.

    Attributes:
        is_certain: times are within ``bound_ns``.
        rate_error: by how much it runs fast; 1e-3 are 0.1 %.
        steps: how often it jumped or stood still.
    """

    device: str
    is_certain: bool
    rate_error: float
    bound_ns: int
    steps: int = 0


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
    | RepeatedCount
    | DeviceTemperatures
    | DeviceClockState
    | DeviceCounters
)


class DeviceError(Exception):
    """A device failed; states the expectation and a remedy.

    Attributes:
        since_ns: as in `DeviceLost`.
    """

    def __init__(self, text: str, remedy: str, *, since_ns: int = 0) -> None:
        super().__init__(text)
        self.remedy = remedy
        self.since_ns = since_ns


class DeviceNotFoundError(DeviceError):
    """The port is missing or not permitted: check cable and rights."""


class DeviceRefusedError(DeviceError):
    """The device is there, but is not the one that was configured."""
