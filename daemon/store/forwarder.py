"""From the disk to the broker: some messages at a time, however many there are.

A new message enters the outgoing queue from memory as long as all before it are there.
Else it stays on the disk, and is read when those before it were sent: memory holds a
few hundred points, whatever the broker does.

What the broker refuses, by an access list say, is retried after some minutes, and
all after it only then: a broker that accepts nothing is not kept busy.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from traverse.daemon.clock import HostClock
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import (
    read_messages,
    read_unsent,
)
from traverse.daemon.store.records import (
    NewMessage,
    RetentionRules,
    StorageError,
    StoredMessage,
    StoreStatus,
    WriteJob,
)
from traverse.daemon.store.writer import StoreWriter
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.protocol.topics import CHANNELS

log = logging.getLogger("traverse.daemon.outbox")
T = TypeVar("T")

Range = tuple[int, int]

BATCH = 100
REFUSED_NS = 120_000_000_000
RESEND_BATCH = 50
MAX_RANGES = 32


class AckBuffer:
    """Collect numbers, as ranges: answers arrive nearly in order.

    Args:
        writer: marks them in the database.
    """

    def __init__(self, writer: StoreWriter) -> None:
        self._writer = writer
        self._ranges: list[Range] = []
        self._is_writing = False

    def add(self, number: int) -> None:
        """The broker has this one."""
        if self._ranges and self._ranges[-1][1] == number - 1:
            self._ranges[-1] = self._ranges[-1][0], number
        else:
            self._ranges.append((number, number))

    def flush(self) -> None:
        """Have written what has been collected, if nothing is being written."""
        if self._is_writing or not self._ranges:
            return
        ranges, self._ranges = self._ranges, []
        self._is_writing = True

        def told(outcome: object) -> None:
            self._is_writing = False
            if isinstance(outcome, Exception):  # again later; until then they are here
                self._ranges = _joined(ranges + self._ranges)

        self._writer.query(lambda store: store.mark_sent(ranges), told)


def _joined(ranges: list[Range]) -> list[Range]:
    """The same numbers in as few ranges as possible."""
    joined: list[Range] = []
    for first, last in sorted(ranges):
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = joined[-1][0], max(last, joined[-1][1])
        else:
            joined.append((first, last))
    return joined


def outgoing(
    message: StoredMessage,
    sent: Callable[[], None] | None = None,
    refused: Callable[[], None] | None = None,
) -> OutgoingMessage:
    """A message of the database as it is handed to the broker."""
    return OutgoingMessage(
        message.topic,
        message.payload,
        qos=CHANNELS["point"].qos,
        sent=sent,
        refused=refused,
        encoding=message.encoding,
    )


class UnsentFeeder:
    """Puts all messages into the queue that the broker does not have, in order.

    Args:
        queue: of what is to be published.
        writer: reads them from the database.
        acks: collects the number of each that the broker has.
        clock: the host's.
        latency: receives how long the broker took for each.
        kind: under which they wait in the queue.
        together: so many are read at once, when no more than that wait.

    Attributes:
        has_backlog: messages wait on the disk, or may.
    """

    def __init__(
        self,
        queue: OutgoingQueue,
        writer: StoreWriter,
        acks: AckBuffer,
        clock: HostClock,
        latency: Latencies,
        *,
        kind: str = "point",
        together: int = BATCH,
    ) -> None:
        self._queue = queue
        self._writer = writer
        self._acks = acks
        self._clock = clock
        self._latency = latency
        self._kind = kind
        self._together = together
        self._last_number = 0  # of those that are, or were, in the queue
        self.has_backlog = True  # at the start: an earlier run may have left some
        self._is_reading = False
        self._refused: int | None = None  # the first of them
        self._resumes_ns = 0

    def kept(self, message: StoredMessage) -> None:
        """A new message is on the disk."""
        if not self.has_backlog:
            self.has_backlog = not self._offer(message)

    def look_again(self) -> None:
        """The database may hold messages that nobody has reported."""
        self.has_backlog = True
        self.refill()

    def refill(self) -> None:
        """Read on, where messages wait on the disk and there is room for them."""
        if (
            not self.has_backlog
            or self._is_reading
            or self._queue.waiting(self._kind) > self._together
            or not self._may_resume()
        ):
            return
        self._is_reading = True
        after = self._last_number
        self._writer.query(
            lambda store: read_unsent(store.connection, after, self._together),
            self._read,
        )

    def _may_resume(self) -> bool:
        """Nothing was refused, or that is long ago: then it is read once more."""
        if self._refused is None:
            return True
        is_due = self._clock.monotonic_ns() >= self._resumes_ns
        if not is_due or self._queue.waiting(self._kind):
            return False
        self._last_number, self._refused = self._refused - 1, None
        return True

    def _read(self, found: object) -> None:
        self._is_reading = False
        if self._refused is not None:
            return  # meanwhile; it is read again when that is tried again
        if not isinstance(found, Sequence):
            return  # it cannot be read now; `refill` is called again
        # Messages stored after this read are reported after it: nothing is missed.
        self.has_backlog = len(found) == self._together
        for message in found:
            if not self._offer(message):
                self.has_backlog = True
                return

    def _offer(self, message: StoredMessage) -> bool:
        number, begun_ns = message.number, self._clock.monotonic_ns()

        def sent() -> None:
            self._latency.add(self._clock.monotonic_ns() - begun_ns)
            self._acks.add(number)

        def refused() -> None:
            self.has_backlog = True
            first = number if self._refused is None else self._refused
            self._refused = min(first, number)
            self._resumes_ns = self._clock.monotonic_ns() + REFUSED_NS

        there = self._queue.offer(self._kind, outgoing(message, sent, refused))
        if there:
            self._last_number = number
        return there


class RangeResender:
    """Sends ranges again, one after the other.

    Args:
        queue: of what is to be published.
        writer: reads them from the database.
        together: so many messages are read at once.
    """

    def __init__(
        self,
        queue: OutgoingQueue,
        writer: StoreWriter,
        together: int = RESEND_BATCH,
    ) -> None:
        self._queue = queue
        self._writer = writer
        self._together = together
        self._ranges: deque[tuple[str, int, int]] = deque()
        self._is_reading = False

    def check_room(self) -> None:
        """See that another range may wait.

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
        """Begin to send a range again."""
        self._ranges.append((session, from_seq, to_seq))
        self.refill()

    def refill(self) -> None:
        """Read on, where there is something to read and room for it."""
        if (
            not self._ranges
            or self._is_reading
            or self._queue.waiting("resend") > self._together
        ):
            return
        self._is_reading = True
        session, from_seq, to_seq = self._ranges[0]
        self._writer.query(
            lambda store: read_messages(
                store.connection, session, from_seq, to_seq, self._together
            ),
            self._read,
        )

    def _read(self, found: object) -> None:
        self._is_reading = False
        session, _, to_seq = self._ranges.popleft()
        if not isinstance(found, Sequence):
            log.warning("session %s is not sent again: %s", session, found)
            return  # the consumer sees a gap, and requests again
        for message in found:
            self._queue.offer("resend", outgoing(message))
        if len(found) == self._together and found[-1].seq < to_seq:
            self._ranges.appendleft((session, found[-1].seq + 1, to_seq))
        self.refill()

    async def query(self, work: Callable[[MessageDatabase], T]) -> T:
        """The result of a job of the database.

        Raises:
            RequestRefusedError: it cannot be done.
        """
        waiting: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def told(outcome: object) -> None:
            if waiting.done():
                return
            if isinstance(outcome, Exception):
                waiting.set_exception(outcome)
            else:
                waiting.set_result(outcome)  # type: ignore[arg-type]  # what `work` gave

        self._writer.query(work, told)
        try:
            return await waiting
        except Exception as error:
            raise RequestRefusedError(
                "outbox.failed",
                f"the outbox cannot be read: {error}",
                "see `outbox` in health, and the event outbox.failed",
            ) from error


class MessageForwarder:
    """Has messages kept, sent in order, marked, and sent again.

    Args:
        path: of the database.
        clock: the host's.
        queue: of what is to be published.
        rules: what may be deleted.
        kept: called with the numbers of messages that are safe now, in order.
        failed: called with the reason why pending writes will fail.
        changed: called with the state of the database when it changes.
        replaced: called with a text when a new database has been begun.
        latency: receives how long the broker took for each message.
        kind: under which new messages wait in the queue.
        name: of the thread.
        together: so many are read at once, when no more than that wait.
        resent_together: the same of those that were requested again.

    Attributes:
        feed: sends what the broker does not have.
        again: sends ranges that it has had.
    """

    def __init__(
        self,
        path: Path,
        clock: HostClock,
        queue: OutgoingQueue,
        rules: RetentionRules,
        *,
        kept: Callable[[list[int]], None],
        failed: Callable[[StorageError], None],
        changed: Callable[[StoreStatus], None],
        replaced: Callable[[str], None],
        latency: Latencies,
        kind: str = "point",
        name: str = "outbox",
        together: int = BATCH,
        resent_together: int = RESEND_BATCH,
    ) -> None:
        self._rules = rules
        self._failed = failed
        self._replaced = replaced
        self._generation = 0
        self._writer = StoreWriter(
            path,
            clock,
            rules,
            kept=kept,
            failed=self._generation_failed,
            changed=changed,
            replaced=self._begun_anew,
            name=name,
        )
        self._acks = AckBuffer(self._writer)
        self.feed = UnsentFeeder(
            queue,
            self._writer,
            self._acks,
            clock,
            latency,
            kind=kind,
            together=together,
        )
        self.again = RangeResender(queue, self._writer, resent_together)

    @property
    def heartbeat(self) -> Heartbeat:
        """Signs of life of the thread."""
        return self._writer.heartbeat

    async def open(self) -> None:
        """Start the thread; where the disk refuses, it tries again and again.

        Raises:
            StoreRefusedError: the database must be left alone.
        """
        await self._writer.start()

    async def close(self) -> None:
        """Write what the broker has and all that waits, then end the thread."""
        self._acks.flush()
        await self._writer.close()

    def keep(self, entry: NewMessage) -> None:
        """Send a message to the disk."""
        self._writer.put(WriteJob(self._generation, entry))

    def poll(self, rules: RetentionRules) -> None:
        """Go by these rules, and go on with what has been put off."""
        if rules != self._rules:
            self._rules = rules
            self._writer.put(rules)
        self._acks.flush()
        self.refill()

    def refill(self) -> None:
        """Read on, where there is something to read and room for it."""
        self.feed.refill()
        self.again.refill()

    def _generation_failed(self, generation: int, trouble: StorageError) -> None:
        self._generation = generation + 1
        self._failed(trouble)

    def _begun_anew(self, text: str) -> None:
        self._replaced(text)
        self.feed.look_again()
