"""The way of messages through a database: to its thread, from there to the broker."""

from collections.abc import Callable
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.ack_buffer import AckBuffer, Range
from traverse.daemon.store.feed import TOGETHER, Told, UnsentFeeder, Work
from traverse.daemon.store.jobs import Ask, Condition, Keep, Rules
from traverse.daemon.store.records import Entry, StorageError
from traverse.daemon.store.resend import TOGETHER as RESEND_BATCH
from traverse.daemon.store.resend import RangeResender
from traverse.daemon.store.writer import StoreWriter
from traverse.drivers.base.heartbeat import Heartbeat


class MessageForwarder:
    """Has messages kept, sent in order, marked, and sent again.

    Args:
        path: of the database.
        clock: the host's.
        queue: of what is to be published.
        rules: what may be forgotten.
        kept: told the numbers of messages that are safe now, in order.
        failed: told why nothing of what is on its way to the disk will get there.
        changed: told how the database is, whenever that is another.
        replaced: told in words when a new database has been begun.
        latency: told how long the broker took for each message.
        kind: under which new messages wait in the queue.
        name: of the thread.
        together: so many are read at once, when no more than that wait.
        resent_together: the same of those that somebody wants again.

    Attributes:
        feed: sends what the broker does not have.
        again: sends ranges that it has had.
    """

    def __init__(
        self,
        path: Path,
        clock: HostClock,
        queue: OutgoingQueue,
        rules: Rules,
        *,
        kept: Callable[[list[int]], None],
        failed: Callable[[StorageError], None],
        changed: Callable[[Condition], None],
        replaced: Callable[[str], None],
        latency: Latencies,
        kind: str = "point",
        name: str = "outbox",
        together: int = TOGETHER,
        resent_together: int = RESEND_BATCH,
    ) -> None:
        self._rules = rules
        self._failed = failed
        self._replaced = replaced
        self._generation = 0
        self._thread = StoreWriter(
            path,
            clock,
            rules,
            kept=kept,
            failed=self._generation_failed,
            changed=changed,
            replaced=self._begun_anew,
            name=name,
        )
        self._marks = AckBuffer(self._write_marks)
        self.feed = UnsentFeeder(
            queue,
            self.ask,
            self._marks.add,
            clock,
            latency,
            kind=kind,
            together=together,
        )
        self.again = RangeResender(queue, self.ask, resent_together)

    @property
    def heartbeat(self) -> Heartbeat:
        """Signs of life of the thread."""
        return self._thread.heartbeat

    async def open(self) -> None:
        """Start the thread; where the disk refuses, it tries again and again.

        Raises:
            StoreRefusedError: the database must be left alone.
        """
        await self._thread.start()

    async def close(self) -> None:
        """Do all that has been asked, and end the thread."""
        await self._thread.close()

    def keep(self, entry: Entry) -> None:
        """Send a message to the disk."""
        self._thread.put(Keep(self._generation, entry))

    def ask(self, work: Work, told: Told) -> None:
        """Have something done with the database."""
        self._thread.put(Ask(work, told))

    def poll(self, rules: Rules) -> None:
        """Go by these rules, and go on with what has been put off."""
        if rules != self._rules:
            self._rules = rules
            self._thread.put(rules)
        self.mark()
        self.refill()

    def mark(self) -> None:
        """Have written down what the broker has."""
        self._marks.flush()

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

    def _write_marks(self, ranges: list[Range], told: Told) -> None:
        self.ask(lambda store: store.mark_sent(ranges), told)
