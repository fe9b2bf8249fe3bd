"""The line to one RLS encoder: a request and its reply, or replies by themselves."""

from collections.abc import Callable
from dataclasses import dataclass

from traverse.drivers.io.ports import BytePort
from traverse.drivers.polling.channel import ReadError
from traverse.protocol import rls

SILENT = ReadError(
    "silent", "does not answer", "check its power, its wires and baud rate"
)
SHORT = ReadError("short", "answers with too few bytes", "check cable and baud rate")
GARBLED = ReadError(
    "garbled",
    "answers with what is no reply",
    "check cable and baud rate, and that bits and turns are those of the encoder",
)
SHIFTED = ReadError(
    "shifted",
    "sends more than requested",
    "check the cable; is it in the continuous mode?",
)


@dataclass(frozen=True, slots=True)
class TimedPosition:
    """An encoder's reply, and its instant on the host's monotonic clock."""

    position: rls.Position
    time_ns: int


class RlsLine:
    """One encoder, from opening its port to losing it.

    A reply may arrive until ``doubt_ns`` after its request failed.

    Attributes:
        port: the port.
        request: the last one.
        unrequested_bytes: unexpected bytes.
        latest: last reply of the continuous mode, until it is taken.
        last_ns: how long the last good exchange took.
        reply_duration_ns: time on the wire of an unsolicited reply.
        exchange_ns: how long the longest good exchange took.
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
        self._doubt_ns = doubt_ns
        self._heard = b""
        self._wanted = 0
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
        """The reply is not yet whole."""
        return len(self._heard) < self._wanted

    def ask(self, request: bytes) -> None:
        """Send a request; discard earlier bytes."""
        if self.port.wait(0.0):
            self.unrequested_bytes += len(self.port.read())
        self.request = request
        self._wanted = self._layout.reply_bytes(request)
        self._heard, self._surplus = b"", False
        self.port.write(request)
        self._sent_ns = self._received_ns = self._now_ns()

    def waited_ns(self) -> int:
        """Time since the request."""
        return self._now_ns() - self._sent_ns

    def receive(self) -> None:
        """Process what has arrived after a request."""
        data = self.port.read()
        if self.reply_is_incomplete:
            self._received_ns = self._now_ns()
        missing = self._wanted - len(self._heard)
        self._heard += data[:missing]
        if len(data) > missing:
            self.unrequested_bytes += len(data) - missing
            self._surplus = True

    def discard_late_bytes(self) -> None:
        """Process bytes when nothing is due any more: a late reply, or a next one."""
        self.unrequested_bytes += len(self.port.read())
        self._surplus |= not self.reply_is_incomplete

    def reply(self) -> bytes | ReadError:
        """The whole reply, or why there is none."""
        miss: ReadError | None = None
        if self._surplus:
            miss = SHIFTED
        elif self.reply_is_incomplete:
            miss = SHORT if self._heard else SILENT
        self._wanted = 0
        if miss is not None:
            return self._failed(miss)
        self.last_ns = self._received_ns - self._sent_ns
        self.exchange_ns = max(self.exchange_ns, self.last_ns)
        return self._heard

    def answer(self) -> TimedPosition | ReadError:
        """The reply to a request for a position."""
        reply = self.reply()
        if isinstance(reply, ReadError):
            return reply
        found = rls.position(reply, self.request, self._layout)
        if found is None:
            return self._failed(GARBLED)
        return TimedPosition(found, (self._sent_ns + self._received_ns) // 2)

    def follow(self, request: bytes) -> None:
        """From now on the encoder answers a request by itself."""
        self._replies = rls.Replies(request, self._layout)
        self.reply_duration_ns = self._layout.reply_bytes(request) * self._byte_ns
        self.latest = None

    def listen(self) -> None:
        """Process unsolicited replies."""
        data = self.port.read()
        now_ns = self._now_ns()
        if self._replies is None:
            self.unrequested_bytes += len(data)
            return
        skipped = self._replies.skipped
        found = self._replies.feed(data)
        self.unrequested_bytes += self._replies.skipped - skipped
        if found:
            self.latest = TimedPosition(found[-1], now_ns - self.reply_duration_ns)

    def _failed(self, miss: ReadError) -> ReadError:
        self._doubted_until_ns = self._sent_ns + self._doubt_ns
        return miss
