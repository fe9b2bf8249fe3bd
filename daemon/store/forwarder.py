"""From the disk to the broker, a few messages at a time.

A new message enters the outgoing queue from memory if all before it are there.
Otherwise it stays on the disk and is read when those before it were sent, so that
memory holds a few hundred messages at most.

A message that the broker refuses, for instance by an access list, is retried after some
minutes, and those after it only then.
"""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

from traverse.daemon.clock import HostClock
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.store.queries import read_messages, read_unsent
from traverse.daemon.store.records import StorableMessage
from traverse.daemon.store.writer import StoreWriter
from traverse.protocol.topics import CHANNELS

log = logging.getLogger("traverse.daemon.outbox")

Range = tuple[int, int]

BATCH = 100
REFUSED_NS = 120_000_000_000
RESEND_BATCH = 50
MAX_RANGES = 32


class AckBuffer:
    """Collects acknowledged numbers as ranges."""

    def __init__(self, writer: StoreWriter) -> None:
        self._writer = writer
        self._ranges: list[Range] = []
        self._is_writing = False

    def add(self, number: int) -> None:
        """Add the number of an acknowledged message."""
        self._add(number, number)

    def flush(self, *, is_last: bool = False) -> bool:
        """Write collected ranges, unless a write is under way; whether one began."""
        if (self._is_writing and not is_last) or not self._ranges:
            return False
        ranges, self._ranges = self._ranges, []
        self._is_writing = True

        def on_result(outcome: object) -> None:
            self._is_writing = False
            if isinstance(outcome, Exception):  # again later; until then they are here
                newer, self._ranges = self._ranges, ranges
                for ends in newer:
                    self._add(*ends)

        self._writer.query(lambda store: store.mark_sent(ranges), on_result)
        return True

    def _add(self, first: int, last: int) -> None:
        if self._ranges and self._ranges[-1][1] == first - 1:
            first, _ = self._ranges.pop()
        self._ranges.append((first, last))


def outgoing(
    message: StorableMessage,
    sent: Callable[[], None] | None = None,
    refused: Callable[[], None] | None = None,
) -> OutgoingMessage:
    """Convert a message of the database for the outgoing queue."""
    return OutgoingMessage(
        message.topic,
        message.payload,
        qos=CHANNELS["point"].qos,
        sent=sent,
        refused=refused,
        encoding=message.encoding,
    )


@dataclass(eq=False)
class UnsentFeeder:
    """Queues all messages that the broker lacks, in order.

    Args:
        batch: most messages read at once, and most waiting.

    Attributes:
        has_backlog: messages may wait on the disk.
    """

    queue: OutgoingQueue
    writer: StoreWriter
    acks: AckBuffer
    clock: HostClock
    latency: Latencies
    _: KW_ONLY
    kind: str = "point"
    batch: int = BATCH

    def __post_init__(self) -> None:
        self._last_number = 0  # of those that are, or were, in the queue
        self.has_backlog = True  # at the start: an earlier run may have left some
        self._is_reading = False
        self._refused: int | None = None  # the first of them
        self._resumes_ns = 0

    def add(self, number: int, message: StorableMessage) -> None:
        if not self.has_backlog:
            self.has_backlog = not self._offer(number, message)

    def refill(self) -> None:
        """Read on if messages wait on the disk and there is room."""
        if (
            not self.has_backlog
            or self._is_reading
            or self.queue.waiting(self.kind) > self.batch
            or not self._may_resume()
        ):
            return
        self._is_reading = True
        after = self._last_number
        self.writer.query(
            lambda store: store.read(read_unsent, after, self.batch), self._read
        )

    def _may_resume(self) -> bool:
        """Return whether nothing was refused, or the pause after it is over."""
        if self._refused is None:
            return True
        is_due = self.clock.monotonic_ns() >= self._resumes_ns
        if not is_due or self.queue.waiting(self.kind):
            return False
        self._last_number, self._refused = self._refused - 1, None
        return True

    def _read(self, messages: object) -> None:
        self._is_reading = False
        if self._refused is not None:
            return  # meanwhile; it is read again when that is tried again
        if not isinstance(messages, Sequence):
            return  # it cannot be read now; `refill` is called again
        # What was committed after this was read is added after it: nothing is missed.
        self.has_backlog = len(messages) == self.batch
        for message in messages:
            if not self._offer(message.number, message):
                self.has_backlog = True
                return

    def _offer(self, number: int, message: StorableMessage) -> bool:
        begun_ns = self.clock.monotonic_ns()

        def sent() -> None:
            self.latency.add(self.clock.monotonic_ns() - begun_ns)
            self.acks.add(number)
            self.refill()

        def refused() -> None:
            self.has_backlog = True
            first = number if self._refused is None else self._refused
            self._refused = min(first, number)
            self._resumes_ns = self.clock.monotonic_ns() + REFUSED_NS

        is_queued = self.queue.offer(self.kind, outgoing(message, sent, refused))
        if is_queued:
            self._last_number = number
        return is_queued


@dataclass(eq=False)
class RangeResender:
    """Sends ranges again, one after the other.

    Args:
        batch: most messages read at once, and most waiting.
    """

    queue: OutgoingQueue
    writer: StoreWriter
    batch: int = RESEND_BATCH

    def __post_init__(self) -> None:
        self._ranges: deque[tuple[str, int, int]] = deque()
        self._is_reading = False

    def check_room(self) -> None:
        """Check that another range may wait.

        Raises:
            RequestRefusedError: too many do.
        """
        if len(self._ranges) >= MAX_RANGES:
            raise RequestRefusedError(
                "resend.busy",
                f"{MAX_RANGES} ranges are being sent again already",
                "wait until they have arrived, then send a new request",
            )

    def send(self, session: str, from_seq: int, to_seq: int) -> None:
        self._ranges.append((session, from_seq, to_seq))
        self.refill()

    def refill(self) -> None:
        """Read on if there is something to read and room for it."""
        if (
            not self._ranges
            or self._is_reading
            or self.queue.waiting("resend") > self.batch
        ):
            return
        self._is_reading = True
        ends = self._ranges[0]
        self.writer.query(
            lambda store: store.read(read_messages, *ends, self.batch), self._read
        )

    def _read(self, messages: object) -> None:
        self._is_reading = False
        session, _, to_seq = self._ranges.popleft()
        if not isinstance(messages, Sequence):
            log.warning("session %s is not sent again: %s", session, messages)
            return  # the consumer sees a gap, and requests again
        for message in messages:
            self.queue.offer("resend", outgoing(message, self.refill))
        if len(messages) == self.batch and messages[-1].seq < to_seq:
            self._ranges.appendleft((session, messages[-1].seq + 1, to_seq))
        self.refill()
