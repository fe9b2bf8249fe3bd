"""Base class of drivers whose encoders are polled one after the other.

Sample k is due at k / rate; then all encoders are polled in turn. Each reading has its
own instant, stated as `CountSamples.skew_ns`; the consumer interpolates them to one. An
instant that the line was too slow for is skipped, and is a gap in ``seq``.
"""

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median
from typing import Generic, Protocol, TypeVar

from pydantic import Field

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import ASK_S, Driver, DriverOptions
from traverse.drivers.base.values import DeviceError, DeviceUp, Identity
from traverse.drivers.io.ports import SERIAL_PORTS, PortAccess
from traverse.drivers.polling.alarms import ReadErrorLog
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.sampling import (
    SampleBlockBuilder,
    SampleSchedule,
    sample_of_readings,
)
from traverse.plurals import counted

FIRST_CYCLES = 8  # to get acquainted, and to learn how long a cycle takes
LENGTHS = 256  # of polling, that are stored
MOST_POLLS = 3  # of one encoder in a cycle
SLOW_RATIO = 1.2  # of the bound of an instant to the usual one
USUAL_WEIGHT = 1.0 / 64.0
LEAST_UNKNOWN_RAD = 1e-4  # 0.07 mm at 0.7 m
SHARE_OF_LINE = 0.8  # of the time may be spent polling
EXCHANGE_NS = 2_000_000_000  # nobody puts another encoder there sooner
IDLE_S = 0.5  # without a stream, so often is looked whether all are there

DISTURBED = ReadError(
    "disturbed",
    "was polled while unexpected bytes were on the line",
    "check termination, cable and shielding, and that there is no other master",
)


class PolledOptions(DriverOptions):
    """Options of every driver that reads its encoders one after the other.

    Attributes:
        answer_timeout_s: time limit of a reply.
        max_rate_hz: bound on the rate of streams.
    """

    answer_timeout_s: float
    max_rate_hz: float
    max_speed_rad_s: float = Field(default=20.0, ge=1.0, le=1000.0)


class PolledLine(Protocol):
    """The line or lines to the encoders of a driver."""

    @property
    def unrequested_bytes(self) -> int:
        """Number of bytes received without a request."""

    def close_port(self) -> None:
        """Close the ports."""


LineT = TypeVar("LineT", bound=PolledLine)


class PolledDriver(Driver, Generic[LineT]):
    """A device whose channels are read one after the other.

    A child overrides `_open`, which sets `_line`, and `_read_channel`.
    """

    options: PolledOptions

    def __init__(
        self,
        device: str,
        options: PolledOptions,
        delivery_queue: DeliveryQueue,
        *,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        ports: PortAccess = SERIAL_PORTS,
    ) -> None:
        super().__init__(device, options, delivery_queue, monotonic_ns=monotonic_ns)
        self._ports = ports
        # The thread's own.
        self._line: LineT | None = None
        self._unrequested_before = 0  # on lines that were lost
        self._channels: Sequence[PolledChannel] = ()
        self._serials: tuple[str, ...] = ()  # `_open` sets those that there are
        self._reached_hz = 0.0
        self._schedule: SampleSchedule | None = None
        self._lengths_ns: deque[int] = deque(maxlen=LENGTHS)
        self._usual_bound_ns = 0.0
        self._block = SampleBlockBuilder(device, delivery_queue.put)
        self._read_errors = ReadErrorLog(device, delivery_queue.put, self._counters)

    # -- for a child to override ----------------------------------------------

    @abstractmethod
    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        """Open the ports; return the device's name and channels.

        Raises:
            DeviceError: it is missing, or not as configured.
        """

    @abstractmethod
    def _read_channel(self, channel: int) -> EncoderReading | ReadError:
        """Poll one encoder.

        Raises:
            DeviceError: the port is lost.
        """

    def _cycle_is_valid(self) -> bool:
        """Check a cycle; False makes all of its readings missing."""
        return True

    def _wait(self, seconds: float) -> None:
        self._ports.wait_for_any((), self._wake_read, seconds)

    # -- in the reader thread -------------------------------------------------

    @property
    def _open_line(self) -> LineT:
        if self._line is None:
            raise RuntimeError(f"the line of {self.device} is not open")
        return self._line

    def _disconnect(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            self._unrequested_before += line.unrequested_bytes
            line.close_port()

    def _connect(self) -> None:
        name, self._channels = self._open()
        self._schedule = None
        lengths_ns = []
        for _ in range(FIRST_CYCLES):
            begun_ns = self._now_ns()
            self._cycle()
            lengths_ns.append(self._now_ns() - begun_ns)
        self._read_errors.raise_if_all_missing(self._channels)
        usual_ns = max(1.0, median(lengths_ns))
        fastest_hz = SHARE_OF_LINE * 1e9 / usual_ns
        self._reached_hz = min(self.options.max_rate_hz, fastest_hz)
        identity = Identity(
            name,
            "",
            tuple(channel.modulus for channel in self._channels),
            inputs=0,
            max_rate_hz=self._reached_hz,
            latches=False,
            counts_per_turn=tuple(c.counts_per_turn for c in self._channels),
            jitter_ns=self._jitter_ns(),
            absolute=True,
            serials=self._serials,
            reads_in_turn=True,
        )
        self._deliver_state(DeviceUp(self.device, identity, restarted=False))
        self._streams_begun = 0  # the requested stream is to be started again
        self._read_errors.report(self._channels, self._now_ns())

    def _serve(self) -> None:
        try:
            while not self._stopping:
                if self._streams_begun != (n_requested := self._streams_requested):
                    self._streams_begun = n_requested
                    self._begin_stream(self._rate_hz)
                if self._schedule is None:
                    self._wait(IDLE_S)
                    self._cycle()
                else:
                    self._serve_stream(self._schedule)
                self._read_errors.raise_if_all_missing(self._channels)
                self._raise_if_another()
                self._read_errors.report(self._channels, self._now_ns())
                self._report_counters()
        finally:
            self._block.finish(self._stream, self._doubts())

    def _raise_if_another(self) -> None:
        """Raise DeviceError if an encoder is back that may be another one."""
        for number, channel in enumerate(self._channels):
            is_known = bool(self._serials) and bool(self._serials[number])
            if channel.away_ns > EXCHANGE_NS and not is_known:
                raise DeviceError(
                    f"{channel.name} was away for {channel.away_ns * 1e-9:.1f} s, and "
                    "no serial number shows that it is the same",
                    "if it is, confirm it",
                )

    def _begin_stream(self, rate_hz: float) -> None:
        self._block.finish(self._stream, self._doubts())
        self._schedule = None
        if not rate_hz:
            return
        rate_hz = self._start_stream(
            rate_hz,
            self._reached_hz,
            "lower the rate, or set the adapter's latency timer to 1 ms",
        )
        is_checked = all(channel.is_checked for channel in self._channels)
        self._block.begin(rate_hz, is_checked=is_checked)
        self._schedule = SampleSchedule(rate_hz, self._now_ns())

    def _serve_stream(self, schedule: SampleSchedule) -> None:
        left_ns = schedule.next_ns - self._now_ns()
        if left_ns > 0:
            self._wait(left_ns * 1e-9)
            return  # perhaps woken early, for another stream or the end
        seq, instant_ns, skipped = schedule.take(self._now_ns())
        if skipped:
            self._fault(
                "samples_lost",
                f"{counted(skipped, 'sample')} lost because reading {self.device} "
                "took too long",
                "lower the rate; see the counters for encoders that do not answer",
                skipped,
            )
        readings = self._cycle()
        self._counters["samples_received"] += 1
        now_ns = self._now_ns()
        counts = [channel.count for channel in self._channels]
        sample = sample_of_readings(instant_ns, readings, counts, now_ns)
        self._block.add(seq, sample, self._doubts())
        if self._block.is_due(now_ns):
            self._block.deliver(self._stream)

    def _cycle(self) -> list[EncoderReading | None]:
        """Poll every encoder that is due; None for invalid readings."""
        answers: list[EncoderReading | ReadError | None] = [
            self._polled(number) if channel.due(self._now_ns()) else None
            for number, channel in enumerate(self._channels)
        ]
        sound = self._cycle_is_valid()
        unrequested = self._open_line.unrequested_bytes
        self._counters["stray_bytes"] = self._unrequested_before + unrequested
        return [
            self._judged(number, answer if sound or answer is None else DISTURBED)
            for number, answer in enumerate(answers)
        ]

    def _doubts(self) -> int:
        """Return the current marks of readings, bits ``STATUS_*``."""
        now_ns = self._now_ns()
        return max((channel.status(now_ns) for channel in self._channels), default=0)

    def _polled(self, number: int) -> EncoderReading | ReadError:
        """Poll an encoder; again while it takes unusually long, and there is time."""
        best = self._polled_once(number)
        for _ in range(MOST_POLLS - 1):
            if isinstance(best, ReadError) or not self._is_slow(number, best):
                break
            again = self._polled_once(number)
            if isinstance(again, EncoderReading):
                best = min(best, again, key=lambda reading: reading.bound_ns)
            elif again.is_damage:
                return again
        return best

    def _is_slow(self, number: int, answer: EncoderReading) -> bool:
        """Return whether to poll again: the joint moves, and no sample is skipped."""
        usual_ns = self._usual_bound_ns
        if self._schedule is None or answer.bound_ns <= SLOW_RATIO * usual_ns:
            return False
        if self._channels[number].unknown_rad(answer) < LEAST_UNKNOWN_RAD:
            return False
        length_ns = max(self._lengths_ns[-1], 2 * answer.bound_ns)
        n_left = len(self._channels) - number
        return self._now_ns() + n_left * length_ns < self._schedule.skipped_ns

    def _polled_once(self, number: int) -> EncoderReading | ReadError:
        self.heartbeat.beat(ASK_S)
        begun_ns = self._now_ns()
        answer = self._read_channel(number)
        if isinstance(answer, EncoderReading):
            self._lengths_ns.append(self._now_ns() - begun_ns)
            usual_ns = self._usual_bound_ns or answer.bound_ns
            usual_ns += (answer.bound_ns - usual_ns) * USUAL_WEIGHT
            self._usual_bound_ns = usual_ns
        return answer

    def _jitter_ns(self) -> int:
        """Return the error of a reading's instant: half of an exchange."""
        return round(median(self._lengths_ns) / 2.0)

    def _judged(
        self, number: int, answer: EncoderReading | ReadError | None
    ) -> EncoderReading | None:
        if answer is None:
            return None
        channel = self._channels[number]
        miss = channel.accept(answer, self._now_ns())
        if miss is not None:
            self._read_errors.add(number, channel, miss)
        if miss is not None or not isinstance(answer, EncoderReading):
            return None
        doubts = channel.status(self._now_ns())
        return replace(answer, status=answer.status | doubts) if doubts else answer
