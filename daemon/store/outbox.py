"""The outbox: a point is on the disk before it is acknowledged.

On the event loop; what takes time is done by the thread. A point passes from `put` to
the disk, then to its requester and to the broker, and is marked when the broker
has it. What the broker does not have is sent after a start, first and in order.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import OutboxSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.folder_lock import exclusive_state_dir
from traverse.daemon.store.forwarder import MessageForwarder
from traverse.daemon.store.records import (
    NewMessage,
    PendingWrite,
    PendingWrites,
    RetentionRules,
    StorageError,
    StoreStatus,
    stored_message_of,
)
from traverse.daemon.store.resend import PointResend
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.protocol.encoding import Encoding, encode
from traverse.protocol.messages import OutboxHealth, Point
from traverse.protocol.topics import point_topic


class Outbox:
    """Keeps an arm's points and has them sent.

    Args:
        path: of the database.
        arm: name of the arm, for the topic.
        encoding: of the payloads.
        clock: the host's.
        section: what may be deleted.
        limit: so many points may be on their way to the disk.
        session: gives the id of the running session, which is never deleted for age.
        queue: of what is to be published.
        events: receives troubles.
        latencies: receives how long points took to the disk, and from there to
            the broker.
        changed: called when points can be kept again, or cannot any more.

    Attributes:
        again: executes the command `resend`.
    """

    def __init__(
        self,
        path: Path,
        *,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        section: OutboxSection,
        limit: int,
        session: Callable[[], str],
        queue: OutgoingQueue,
        events: EventLog,
        latencies: Mapping[str, Latencies],
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self._path = path
        self._topic = point_topic(arm)
        self._encoding: Encoding = encoding
        self._clock = clock
        self._section = section
        self._limit = limit
        self._session = session
        self._queue = queue
        self._events = events
        self._latencies = latencies
        self._status_changed = changed
        self._condition = StoreStatus()
        self._is_open = False
        self._in_flight = PendingWrites()
        self._emptied = asyncio.Event()
        self._entries: deque[tuple[int, NewMessage]] = deque()  # begun [ns], and what
        self._forwarder = MessageForwarder(
            path,
            clock,
            queue,
            RetentionRules(section, ""),
            kept=self._kept,
            failed=self._failed,
            changed=self._changed,
            replaced=self._replaced,
            latency=latencies["publish_to_ack"],
        )
        self.again = PointResend(self._forwarder.again)

    @property
    def heartbeat(self) -> Heartbeat:
        """Signs of life of its thread."""
        return self._forwarder.heartbeat

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Keep points while the block lasts.

        Raises:
            StoreRefusedError: the database must be left alone.
        """
        with exclusive_state_dir(self._path.parent):
            await self._forwarder.open()
            self._is_open = True
            self._queue.left = self._forwarder.refill
            try:
                self._forwarder.refill()
                yield
            finally:
                self._queue.left = None
                self._is_open = False
                await self._forwarder.close()

    @property
    def is_ready(self) -> bool:
        """Whether points can be kept."""
        return self._condition.trouble is None

    async def idle(self) -> None:
        """Wait until no point is on its way to the disk."""
        while self._in_flight:
            self._emptied.clear()
            await self._emptied.wait()

    def use(self, section: OutboxSection) -> None:
        """Apply other rules of what may be deleted."""
        self._section = section

    def put(self, point: Point, begun_ns: int, note: str) -> PendingWrite | None:
        """Write a point to the disk; None where too many wait for that.

        Args:
            point: a capture or a retraction.
            begun_ns: when its session began [UTC].
            note: of its session.
        """
        if not self._is_open or len(self._in_flight) >= self._limit:
            return None
        entry = NewMessage(
            point.session,
            begun_ns,
            note,
            point.seq,
            point.id,
            point.time_ns,
            self._topic,
            self._encoding,
            encode(point, self._encoding),
        )
        self._entries.append((self._clock.monotonic_ns(), entry))
        self._forwarder.keep(entry)
        return self._in_flight.add(point)

    def poll(self) -> None:
        """Go on with what has been put off; call it a few times a second."""
        self._forwarder.poll(RetentionRules(self._section, self._session()))

    def health(self) -> OutboxHealth:
        """How the outbox is."""
        figures = self._condition.figures
        return OutboxHealth(
            state="ready" if self.is_ready else "failed",
            points=figures.points,
            unsent=figures.unsent,
            bytes=figures.size_bytes,
            oldest_unsent_ns=figures.oldest_unsent_ns,
        )

    # -- reports of the thread ------------------------------------------------

    def _kept(self, numbers: list[int]) -> None:
        now_ns, took = self._clock.monotonic_ns(), self._latencies["point_to_disk"]
        with self._queue.together():
            for number in numbers:
                begun_ns, entry = self._entries.popleft()
                took.add(now_ns - begun_ns)
                self._forwarder.feed.kept(stored_message_of(entry, number))
        for _ in numbers:  # when they have been written: events may wait, points not
            self._in_flight.keep()
        self._emptied.set()

    def _failed(self, trouble: StorageError) -> None:
        self._entries.clear()
        self._in_flight.fail(trouble)
        self._emptied.set()

    def _changed(self, condition: StoreStatus) -> None:
        was_ready, trouble = self.is_ready, condition.trouble
        self._condition = condition
        self._events.change(
            trouble is not None,
            "error",
            "outbox.failed",
            "points are kept again" if trouble is None else trouble.text,
            source="outbox",
            remedy="" if trouble is None else trouble.remedy,
        )
        if was_ready != self.is_ready:
            self._status_changed()

    def _replaced(self, text: str) -> None:
        self._events.report(
            "error",
            "outbox.replaced",
            text,
            source="outbox",
            remedy="points that only the old file has can be taken out of it with "
            "`traverse points export --db`, as far as it can be read",
        )
