"""The lines to several RLS encoders, which are polled side by side."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from statistics import median

from traverse.drivers.io.ports import PortAccess
from traverse.drivers.rls.line import RlsLine
from traverse.drivers.rls.options import RlsOptions
from traverse.protocol import rls

BETWEEN_BYTES_S = 0.0015  # of settings; the encoder requires 1 ms
BITS_OF_BYTE = 10
DOUBTED_TIMEOUTS = 8  # a reply that arrives later than that is not to our request


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
        """Unexpected bytes."""
        return sum(line.unrequested_bytes for line in self.lines)

    @property
    def longest_ns(self) -> int:
        """How long the longest good exchange took."""
        return max(line.exchange_ns for line in self.lines)

    @property
    def usual_ns(self) -> int:
        """How long the last good exchanges took."""
        return round(median(line.last_ns for line in self.lines))

    def close_port(self) -> None:
        """Close the ports."""
        for line in self.lines:
            line.port.close()

    def exchange(
        self, requests: Mapping[int, bytes], impatient: frozenset[int] = frozenset()
    ) -> None:
        """Poll encoders, all at the same time, and wait for their replies.

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
        """Discard what arrives for a time; the channels on which something arrived."""
        talkers = set()
        for number in self._readable_within(self._all, round(seconds * 1e9)):
            self.lines[number].port.read()
            talkers.add(number)
        return talkers

    def send_setting(self, number: int, setting: bytes) -> None:
        """Send a setting byte by byte; its echo is discarded with all else received."""
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
        """Process unsolicited replies, until woken; at most for a time."""
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
            for other in self._ready(self._all, left_ns):
                self.lines[other].listen()

    def _readable_within(self, numbers: Sequence[int], wait_ns: int) -> Iterator[int]:
        """Numbers of the lines that have bytes, as they have them, for a time."""
        until_ns = self._now_ns() + wait_ns
        while (left_ns := until_ns - self._now_ns()) > 0:
            yield from self._ready(numbers, left_ns)

    def _ready(self, numbers: Sequence[int], wait_ns: int) -> list[int]:
        ports = [self.lines[n].port for n in numbers]
        ready = self._ports.wait_for_any(ports, self._wake_fd, wait_ns * 1e-9)
        return [numbers[index] for index in ready]

    def _usual_ns(self) -> int:
        """A time within which most replies arrive; the time-out until that is known."""
        longest_ns = self.longest_ns
        usual_ns = longest_ns + 1_000_000 if longest_ns else self._timeout_ns
        return min(self._timeout_ns, usual_ns)
