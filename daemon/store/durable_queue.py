"""The durable queue: write, commit, forward, acknowledge, resend, recover.

`put` sends a message to the disk, then to the broker and its requester; it is marked
when the broker has it. Messages that the broker lacks are sent first after a start, in
order. Runs on the event loop; a thread does slow work.

The outbox of points and the store of scan blocks are two configurations of it.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.forwarder import (
    BATCH,
    RESEND_BATCH,
    AckBuffer,
    RangeResender,
    UnsentFeeder,
)
from traverse.daemon.store.records import (
    Committed,
    DatabaseRefusedError,
    NewMessage,
    Notification,
    PendingWrite,
    Removed,
    Replaced,
    RetentionRules,
    SetAside,
    StorageError,
    StoreStatus,
    WriteFailed,
    fail_all,
)
from traverse.daemon.store.writer import StoreWriter
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.plurals import counted

T = TypeVar("T")

POLLS_A_MARK = 4  # a second: to mark what the broker has costs as much as some points


@dataclass(frozen=True, slots=True)
class QueueProfile:
    """Settings that distinguish durable queues.

    Attributes:
        kind: of new messages in the outgoing queue.
        removed: code for removals; empty if they are not reported.
        failed_text: of that event; "{}" is the reason.
        restored_text: of that event at its end.
        replaced_remedy: of the other events.
        batch: most messages read at once, and most waiting.
        resend_batch: the same for requested messages.
    """

    thread: str
    kind: str
    source: str
    failed: str
    failed_text: str
    restored_text: str
    replaced: str
    damaged: str
    replaced_remedy: str = ""
    removed: str = ""
    batch: int = BATCH
    resend_batch: int = RESEND_BATCH


class DurableQueue:
    """Stores messages and has them sent.

    Args:
        publisher: encodes messages and owns the outgoing queue.
        to_disk: receives latencies to the disk.
        to_broker: receives latencies from the disk to the broker.
        ready_changed: called when storing becomes possible or impossible.

    Attributes:
        is_open: started and not closed.
        status: of the database, as its thread last saw it.
    """

    def __init__(
        self,
        path: Path,
        profile: QueueProfile,
        publisher: MessagePublisher,
        events: EventLog,
        *,
        retention: RetentionRules,
        to_disk: Latencies,
        to_broker: Latencies,
        ready_changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.path = path
        self.is_open = False
        self.status = StoreStatus()
        self._profile = profile
        self._encoding = publisher.encoding
        self._clock = clock = publisher.clock
        self._queue = queue = publisher.queue
        self._events = events
        self._to_disk = to_disk
        self._ready_changed = ready_changed
        self._in_flight: deque[tuple[int, NewMessage, PendingWrite]] = deque()
        self._polls = POLLS_A_MARK  # since marks were written
        self._unreported_bytes = 0  # that the status does not count yet
        self._settled = asyncio.Event()
        self._starting: asyncio.Task[None] | None = None
        self._writer = StoreWriter(path, profile.thread, clock, retention, self._notify)
        self._acks = AckBuffer(self._writer)
        self._feeder = UnsentFeeder(
            queue,
            self._writer,
            self._acks,
            clock,
            to_broker,
            kind=profile.kind,
            batch=profile.batch,
        )
        self.resender = RangeResender(queue, self._writer, profile.resend_batch)

    @contextlib.asynccontextmanager
    async def running(self, *, is_needed: bool = True) -> AsyncIterator[None]:
        """Forward messages of an earlier run and store new ones within the block.

        Unless it is needed at once, `start` may be called within the block.

        Raises:
            DatabaseRefusedError: the database must be left alone.
        """
        if is_needed:
            await self.start()
        try:
            yield
        finally:
            self.is_open = False
            if self._starting is not None:
                with contextlib.suppress(DatabaseRefusedError):
                    await self._starting
                    self._acks.flush(is_last=True)
                    await self._writer.close()

    def start(self) -> asyncio.Task[None]:
        """Begin; retry as long as the disk refuses."""
        self.is_open = True
        self._starting = asyncio.create_task(self._writer.start())
        self.refill()
        return self._starting

    def trust_clock(self, is_believed: bool) -> None:
        """State whether UTC is trusted, by which messages age."""
        self._writer.retention_clock.is_believed = is_believed

    @property
    def heartbeats(self) -> tuple[Heartbeat, ...]:
        """Sign of life of its thread, if it runs."""
        return (self._writer.heartbeat,) if self.is_open else ()

    @property
    def is_ready(self) -> bool:
        """Whether messages can be stored."""
        return self.status.trouble is None

    @property
    def n_in_flight(self) -> int:
        """Number of messages on their way to the disk."""
        return len(self._in_flight)

    @property
    def used_bytes(self) -> int:
        """Bytes that messages take on the disk, or will take."""
        return self.status.statistics.used_bytes + self._unreported_bytes

    @property
    def has_backlog(self) -> bool:
        """Whether messages may wait on the disk."""
        return self._feeder.has_backlog

    def put(self, message: NewMessage, write: PendingWrite) -> None:
        """Send a message to the disk; settles ``write`` when it is there, or never."""
        self._unreported_bytes += len(message.payload)
        self._in_flight.append((self._clock.monotonic_ns(), message, write))
        self._writer.write(message)

    async def idle(self) -> None:
        """Wait until no message is on its way to the disk."""
        while self._in_flight:
            self._settled.clear()
            await self._settled.wait()

    def poll(self) -> None:
        """Process deferred work; call a few times a second."""
        if self.is_open:
            self._polls += 1
            if self._polls >= POLLS_A_MARK and self._acks.flush():
                self._polls = 0
            self.refill()

    def refill(self) -> None:
        """Read on if there is something to read and room for it."""
        self._feeder.refill()
        self.resender.refill()

    async def query(self, work: Callable[[MessageDatabase], T]) -> T:
        """Return the result of a job in the database's thread.

        Raises:
            RequestRefusedError: it cannot be done.
        """
        waiting: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def on_result(outcome: object) -> None:
            if waiting.done():
                return
            if isinstance(outcome, Exception):
                waiting.set_exception(outcome)
            else:
                waiting.set_result(outcome)  # type: ignore[arg-type]  # what `work` gave

        self._writer.query(work, on_result)
        try:
            return await waiting
        except Exception as error:
            raise RequestRefusedError(
                "outbox.failed",
                f"the outbox cannot be read: {error}",
                "see `outbox` in health, and the event outbox.failed",
            ) from error

    # -- reports of the thread ------------------------------------------------

    def _notify(self, notification: Notification) -> None:
        match notification:
            case Committed():
                self._commit(notification)
            case WriteFailed(trouble):
                self._writer.resume()
                self._fail(trouble)
            case StoreStatus():
                self._set_status(notification)
            case SetAside(text, count):
                self._report(self._profile.damaged, text, count)
            case Removed(count, why) if self._profile.removed:
                self._events.report(
                    "info",
                    self._profile.removed,
                    f"{counted(count, 'delivered point')} removed ({why})",
                    source=self._profile.source,
                    remedy="raise keep_days or keep_mb of [outbox] to keep more",
                    data={"points": count},
                )
            case Replaced(text):
                self._report(self._profile.replaced, text)
                self._feeder.has_backlog = True  # messages that were taken over
                self.refill()

    def _report(self, code: str, text: str, count: int = 1) -> None:
        self._events.report(
            "error",
            code,
            text,
            source=self._profile.source,
            remedy=self._profile.replaced_remedy,
            count=count,
        )

    def _commit(self, committed: Committed) -> None:
        now_ns, writes = self._clock.monotonic_ns(), []
        for number in committed.numbers:
            begun_ns, message, write = self._in_flight.popleft()
            self._to_disk.add(now_ns - begun_ns)
            self._feeder.add(number, message)
            writes.append(write)
        for write in writes:  # when they have been sent: events may wait, points not
            write.settle()
        self._settled.set()

    def _fail(self, trouble: StorageError) -> None:
        failed = [write for _, _, write in self._in_flight]
        self._in_flight.clear()
        fail_all(failed, trouble)
        self._settled.set()

    def _set_status(self, status: StoreStatus) -> None:
        was_ready, trouble, profile = self.is_ready, status.trouble, self._profile
        self.status = status
        self._unreported_bytes = sum(len(m.payload) for _, m, _ in self._in_flight)
        self._events.change(
            trouble is not None,
            "error",
            profile.failed,
            profile.failed_text.format(trouble.text)
            if trouble
            else profile.restored_text,
            source=profile.source,
            remedy=trouble.remedy if trouble else "",
        )
        if was_ready != self.is_ready:
            self._ready_changed()
