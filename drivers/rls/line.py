"""The line to one RLS encoder: request and reply, or unsolicited replies."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median

from traverse.drivers.io.ports import BytePort, PortAccess
from traverse.drivers.polling.channel import ReadError
from traverse.drivers.polling.exchange import ExchangeTimer
from traverse.drivers.rls.options import RlsOptions
from traverse.protocol import rls

BETWEEN_BYTES_S = 0.0015  # of settings; the encoder requires 1 ms
BITS_OF_BYTE = 10
DOUBTED_TIMEOUTS = 8  # a reply that arrives later than that is not to our request


SILENT = ReadError(
    "silent", "does not answer", "check its power, its wires and baud rate"
)
SHORT = ReadError(
    "short",
    "answers with too few bytes",
    "check cable and baud rate, and that bits and turns are those of the encoder",
)
GARBLED = ReadError(
    "garbled",
    "answers with what is no reply",
    "check cable and baud rate, and that bits and turns are those of the encoder",
    is_damage=True,
)
SHIFTED = ReadError(
    "shifted",
    "sends more than requested",
    "check the cable, and that bits and turns are those of the encoder; is it in the "
    "continuous mode?",
    is_damage=True,
)


@dataclass(frozen=True, slots=True)
class TimedPosition:
    """An encoder's reply, and its instant on the host's monotonic clock.

    Attributes:
        bound_ns: how far the instant may be off.
    """

    position: rls.Position
    time_ns: int
    bound_ns: int


class RlsLine:
    """One encoder, from opening its port to losing it.

    A reply may arrive until ``doubt_ns`` after its request failed.

    Attributes:
        latest: last reply of the continuous mode, until it is taken.
        last_ns: duration of the last good exchange.
        reply_duration_ns: time on the wire of an unsolicited reply.
        exchange_ns: duration of the longest good exchange.
    """

    def __init__(
        self,
        port: BytePort,
        layout: rls.Layout,
        monotonic_ns: Callable[[], int],
        *,
        byte_ns: int,
        doubt_ns: int,
    ) -> None:
        self.port = port
        self.request = b""
        self.unrequested_bytes = 0
        self.latest: TimedPosition | None = None
        self.exchange_ns = self.last_ns = 0
        self._layout = layout
        self._now_ns = monotonic_ns
        self._byte_ns = byte_ns
        self._timer = ExchangeTimer(byte_ns)
        self._doubt_ns = doubt_ns
        self._heard = b""
        self._reply_bytes = 0
        self._sent_ns = self._received_ns = 0
        self._surplus = False
        self._doubted_until_ns = 0
        self.reply_duration_ns = 0
        self._replies: rls.Replies | None = None

    @property
    def may_receive_late_reply(self) -> bool:
        """Whether a reply that timed out may still arrive, in place of another."""
        return self._now_ns() < self._doubted_until_ns

    @property
    def reply_is_incomplete(self) -> bool:
        return len(self._heard) < self._reply_bytes

    def ask(self, request: bytes) -> None:
        """Send a request; discard earlier bytes."""
        if self.port.wait(0.0):
            self.unrequested_bytes += len(self.port.read())
        self.request = request
        self._reply_bytes = self._layout.reply_bytes(request)
        self._heard, self._surplus = b"", False
        self._sent_ns = self._received_ns = self._now_ns()
        self.port.write(request)

    def waited_ns(self) -> int:
        return self._now_ns() - self._sent_ns

    def receive(self) -> None:
        """Process the bytes that arrived after a request."""
        data = self.port.read()
        if self.reply_is_incomplete:
            self._received_ns = self._now_ns()
        missing = self._reply_bytes - len(self._heard)
        self._heard += data[:missing]
        if len(data) > missing:
            self.unrequested_bytes += len(data) - missing
            self._surplus = True

    def discard_late_bytes(self) -> None:
        """Process bytes while nothing is due: a late reply, or a next one."""
        self.unrequested_bytes += len(self.port.read())
        self._surplus |= not self.reply_is_incomplete

    def reply(self) -> bytes | ReadError:
        miss: ReadError | None = None
        if self._surplus:
            miss = SHIFTED
        elif self.reply_is_incomplete:
            miss = SHORT if self._heard else SILENT
        self._reply_bytes = 0
        if miss is not None:
            return self._failed(miss)
        self.last_ns = self._received_ns - self._sent_ns
        self.exchange_ns = max(self.exchange_ns, self.last_ns)
        return self._heard

    def answer(self) -> TimedPosition | ReadError:
        reply = self.reply()
        if isinstance(reply, ReadError):
            return reply
        position = rls.position(reply, self.request, self._layout)
        if position is None:
            return self._failed(GARBLED)
        time_ns, bound_ns = self._timer.latch(
            self._sent_ns, self._received_ns, len(self.request), len(reply)
        )
        return TimedPosition(position, time_ns, bound_ns)

    def follow(self, request: bytes) -> None:
        self._replies = rls.Replies(request, self._layout)
        self.reply_duration_ns = self._layout.reply_bytes(request) * self._byte_ns
        self.latest = None

    def listen(self) -> None:
        data = self.port.read()
        now_ns = self._now_ns()
        if self._replies is None:
            self.unrequested_bytes += len(data)
            return
        skipped = self._replies.skipped
        positions = self._replies.feed(data)
        self.unrequested_bytes += self._replies.skipped - skipped
        if positions:
            duration_ns = self.reply_duration_ns
            at_ns = now_ns - duration_ns
            self.latest = TimedPosition(positions[-1], at_ns, duration_ns // 2)

    def _failed(self, miss: ReadError) -> ReadError:
        self._doubted_until_ns = self._sent_ns + self._doubt_ns
        return miss


class RlsLineGroup:
    """All lines of a device, from opening the ports to losing one."""

    def __init__(
        self,
        options: RlsOptions,
        ports: PortAccess,
        wake_fd: int,
        monotonic_ns: Callable[[], int],
    ) -> None:
        times = {
            "byte_ns": round(BITS_OF_BYTE * 1e9 / options.baud_rate),
            "doubt_ns": round(DOUBTED_TIMEOUTS * options.answer_timeout_s * 1e9),
        }
        with ExitStack() as opened:  # all of them, or none
            self.lines = []
            for path in options.ports:
                port = ports.open(path, options.baud_rate, wake_fd)
                opened.callback(port.close)
                line = RlsLine(port, options.layout, monotonic_ns, **times)
                self.lines.append(line)
            opened.pop_all()
        self._all = range(len(self.lines))
        self._timeout_ns = round(options.answer_timeout_s * 1e9)
        self._now_ns = monotonic_ns
        self._ports, self._wake_fd = ports, wake_fd

    @property
    def unrequested_bytes(self) -> int:
        return sum(line.unrequested_bytes for line in self.lines)

    @property
    def longest_ns(self) -> int:
        return max(line.exchange_ns for line in self.lines)

    @property
    def usual_ns(self) -> int:
        return round(median(line.last_ns for line in self.lines))

    def close_port(self) -> None:
        for line in self.lines:
            line.port.close()

    def exchange(
        self, requests: Mapping[int, bytes], impatient: frozenset[int] = frozenset()
    ) -> None:
        """Poll encoders simultaneously, and wait for their replies.

        Replies of ``impatient`` channels are awaited only as long as most take.
        """
        may_receive_late_reply = {
            n for n in requests if self.lines[n].may_receive_late_reply
        }
        for number, request in requests.items():
            self.lines[number].ask(request)

        def left_ns(number: int) -> int:
            line = self.lines[number]
            if not line.reply_is_incomplete:
                return 0
            patience_ns = self._usual_ns() if number in impatient else self._timeout_ns
            return patience_ns - line.waited_ns()

        while waiting := [n for n in requests if left_ns(n) > 0]:
            for number in self._ready(waiting, max(map(left_ns, waiting))):
                self.lines[number].receive()
        may_receive_late_reply |= {
            n for n in requests if self.lines[n].reply_is_incomplete
        }
        if may_receive_late_reply:
            # A late reply must not pass for the next one.
            for number in self._readable_within(
                sorted(may_receive_late_reply), self._usual_ns()
            ):
                self.lines[number].discard_late_bytes()

    def discard_input(self, seconds: float) -> set[int]:
        talkers = set()
        for number in self._readable_within(self._all, round(seconds * 1e9)):
            self.lines[number].port.read()
            talkers.add(number)
        return talkers

    def send_setting(self, number: int, setting: bytes) -> None:
        """Send a setting byte by byte; discard its echo and all else."""
        port = self.lines[number].port
        for byte in rls.UNLOCK + setting:
            port.write(bytes((byte,)))
            until_ns = self._now_ns() + round(BETWEEN_BYTES_S * 1e9)
            while (left_ns := until_ns - self._now_ns()) > 0:
                self._ports.wait_for_any((), self._wake_fd, left_ns * 1e-9)
            if port.wait(0.0):
                port.read()

    def start_continuous(self, number: int, request: bytes, period_us: int) -> None:
        """Make an encoder answer a request repeatedly."""
        self.send_setting(number, rls.STOP)
        self.send_setting(number, rls.continuous(request, period_us))
        self.lines[number].follow(request)
        self.send_setting(number, rls.START)

    def listen(self, seconds: float) -> None:
        """Process unsolicited replies until woken, or for a time."""
        until_ns = self._now_ns() + round(seconds * 1e9)
        while (left_ns := until_ns - self._now_ns()) > 0:
            ready = self._ready(self._all, left_ns)
            for number in ready:
                self.lines[number].listen()
            if not ready:
                return  # woken, or over

    def listen_for_reply(self, number: int, patience_ns: int) -> None:
        """Wait for a reply of one encoder; the others are read meanwhile."""
        line = self.lines[number]
        until_ns = self._now_ns() + patience_ns
        while line.latest is None and (left_ns := until_ns - self._now_ns()) > 0:
            for readable in self._ready(self._all, left_ns):
                self.lines[readable].listen()

    def _readable_within(self, numbers: Sequence[int], wait_ns: int) -> Iterator[int]:
        """Yield numbers of the lines with bytes, for a time."""
        until_ns = self._now_ns() + wait_ns
        while (left_ns := until_ns - self._now_ns()) > 0:
            yield from self._ready(numbers, left_ns)

    def _ready(self, numbers: Sequence[int], wait_ns: int) -> list[int]:
        ports = [self.lines[n].port for n in numbers]
        ready = self._ports.wait_for_any(ports, self._wake_fd, wait_ns * 1e-9)
        return [numbers[index] for index in ready]

    def _usual_ns(self) -> int:
        """Return a time within which most replies arrive; at first the time-out."""
        longest_ns = self.longest_ns
        usual_ns = longest_ns + 1_000_000 if longest_ns else self._timeout_ns
        return min(self._timeout_ns, usual_ns)
