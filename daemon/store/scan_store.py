"""Scans that are delivered completely: each block is on the disk before it is sent.

On the event loop; a thread of its own writes to `scans.db`, a database like the
outbox's, so a slow disk or an absent broker delays nothing else. Blocks go to the
broker from memory while it keeps up, else from the disk, in order; what it has taken is
stored for some time, so that it can be requested again.

What finds no room is dropped newest first and counted, and shows as a gap in the
numbers: more than `MAX_WAITING` blocks on their way to the disk, or a spool full of
what the broker lacks. While the disk refuses, blocks are sent without having been kept.
"""

import asyncio
import contextlib
import logging
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import OutboxSection, ScanSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.forwarder import MessageForwarder, outgoing
from traverse.daemon.store.queries import block_id
from traverse.daemon.store.records import (
    NewMessage,
    RetentionRules,
    StorageError,
    StoreRefusedError,
    StoreStatus,
    stored_message_of,
)
from traverse.daemon.store.resend import ScanResend
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.protocol.encoding import Encoding, encode
from traverse.protocol.messages import Scan, SpoolHealth
from traverse.protocol.topics import scan_topic

log = logging.getLogger("traverse.daemon.scans")

MAX_WAITING = 200  # blocks on their way to the disk
TOGETHER = 20  # blocks read at once: ten megabytes at most
SENT_SHARE = 0.8  # of the spool that blocks may fill which the broker has


class PendingBlocks:
    """Of one spool.

    Attributes:
        n_bytes: of their messages.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[NewMessage, int]] = deque()
        self._changed = asyncio.Event()
        self.n_bytes = 0

    def __len__(self) -> int:
        return len(self._blocks)

    def add(self, entry: NewMessage, n_points: int) -> None:
        """A block of so many points is on its way."""
        self._blocks.append((entry, n_points))
        self.n_bytes += len(entry.payload)

    def take(self, n: int) -> list[NewMessage]:
        """The first ``n`` are on the disk: gives them."""
        return [entry for entry, _ in self._taken(n)]

    def give_up(self) -> list[tuple[NewMessage, int]]:
        """None will get there: gives them, with their numbers of points."""
        return self._taken(len(self._blocks))

    async def wait_empty(self) -> None:
        """Wait until no block is on its way."""
        while self._blocks:
            self._changed.clear()
            await self._changed.wait()

    def _taken(self, n: int) -> list[tuple[NewMessage, int]]:
        taken = [self._blocks.popleft() for _ in range(n)]
        self.n_bytes -= sum(len(entry.payload) for entry, _ in taken)
        self._changed.set()
        return taken


class ScanStore:
    """Deliver the blocks of scans, as configured.

    Args:
        path: of the database; made when the first scan needs it.
        arm: name of the arm, for the topic.
        encoding: of the payloads.
        clock: the host's.
        section: how scans are delivered, and what of them is kept.
        outlet: for blocks that are not kept.
        queue: of what is to be published.
        events: receives troubles.

    Attributes:
        again: sends blocks again, and reports which exist.
        taken_back: called with a scan and a number of its points that had been accepted
            and are dropped after all; the service sets it.
        counted: blocks `kept`, `unkept` (sent without having been kept), `dropped`.
    """

    def __init__(
        self,
        path: Path,
        *,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        section: ScanSection,
        outlet: MessagePublisher,
        queue: OutgoingQueue,
        events: EventLog,
    ) -> None:
        self._path = path
        self._topic = scan_topic(arm)
        self._encoding: Encoding = encoding
        self._clock = clock
        self._outlet = outlet
        self._queue = queue
        self._events = events
        self.taken_back: Callable[[str, int], None] = lambda scan, n: None
        self._scan, self._begun_ns, self._is_complete = "", 0, False
        self._starting: asyncio.Task[None] | None = None
        self._condition = StoreStatus()
        self._waiting = PendingBlocks()
        self._kept_bytes = 0  # since the condition was reported
        self.counted: Counter[str] = Counter()
        self.use(section)
        self._forwarder = MessageForwarder(
            path,
            clock,
            queue,
            self._rules(),
            kept=self._kept,
            failed=self._failed,
            changed=self._changed,
            replaced=self._replaced,
            latency=Latencies(),
            kind="spooled",
            name="scans",
            together=TOGETHER,
            resent_together=TOGETHER,
        )
        self.again = ScanResend(self._forwarder.again, lambda: self._is_open)

    @property
    def heartbeats(self) -> tuple[Heartbeat, ...]:
        """Signs of life of its thread, while there is one."""
        return (self._forwarder.heartbeat,) if self._is_open else ()

    @property
    def _is_open(self) -> bool:
        return self._starting is not None

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Deliver while the block lasts; first what an earlier run has left.

        Raises:
            StoreRefusedError: the database must be left alone.
        """
        if self._section.delivery == "complete" or self._path.exists():
            self._open()
            if self._starting is not None:
                await self._starting
        left = self._queue.left

        def refill_all() -> None:
            if left is not None:
                left()
            self.refill()

        self._queue.left = refill_all
        try:
            yield
        finally:
            self._queue.left = left
            if self._starting is not None:
                with contextlib.suppress(StoreRefusedError):
                    await self._starting
                    await self._forwarder.close()

    async def idle(self) -> None:
        """Wait until no block is on its way to the disk."""
        await self._waiting.wait_empty()

    def use(self, section: ScanSection) -> None:
        """Go by other settings; a running scan is delivered as it began."""
        self._section = section

    def offer(self, block: Scan) -> bool:
        """Have a block delivered; False where it is dropped."""
        if block.scan != self._scan:
            self._scan, self._begun_ns = block.scan, block.time_ns
            self._is_complete = self._section.delivery == "complete"
        if not self._is_complete:
            return self._outlet.publish("scan", block)
        self._open()
        is_taken = self._take(block)
        if is_taken:
            self._outlet.listener.published(self._clock.monotonic_ns(), block)
        return is_taken

    def poll(self) -> None:
        """Go on with what has been put off; call it a few times a second."""
        if self._is_open:
            self._forwarder.poll(self._rules())

    def refill(self) -> None:
        """Read on, where there is something to read and room for it."""
        if self._is_open:
            self._forwarder.refill()

    def health(self) -> SpoolHealth | None:
        """How the spool is; None where none is used."""
        if not self._is_open:
            return None
        figures = self._condition.figures
        return SpoolHealth(
            state="ready" if self._condition.trouble is None else "failed",
            blocks=figures.points,
            unsent=figures.unsent,
            bytes=figures.size_bytes,
        )

    # -- blocks on their way --------------------------------------------------

    def _take(self, block: Scan) -> bool:
        is_full = self._is_full()
        self._report_full(is_full)
        if is_full or len(self._waiting) >= MAX_WAITING:
            self.counted["dropped"] += 1
            return False
        entry = NewMessage(
            block.scan,
            self._begun_ns,
            block.session,
            block.seq,
            block_id(block),
            block.time_ns,
            self._topic,
            self._encoding,
            encode(block, self._encoding),
        )
        if self._condition.trouble is not None:
            return self._send_unkept(entry)
        self._waiting.add(entry, len(block.dtime_ns))
        self._forwarder.keep(entry)
        return True

    def _report_full(self, is_full: bool) -> None:
        self._events.change(
            is_full,
            "error",
            "scan.spool_full",
            f"{self._path} holds {self._section.spool_mb:g} MB of scans that the "
            "broker lacks; further blocks are dropped"
            if is_full
            else "there is room for scans again",
            source="scan",
            remedy="restore the broker, or raise spool_mb of [scan]" if is_full else "",
        )

    def _is_full(self) -> bool:
        used_bytes = self._condition.figures.used_bytes + self._kept_bytes
        return used_bytes + self._waiting.n_bytes >= self._section.spool_mb * 1e6

    def _send_unkept(self, entry: NewMessage) -> bool:
        """Send what the disk refuses, unless earlier blocks wait there."""
        message = stored_message_of(entry, 0)
        if self._forwarder.feed.has_backlog or not self._queue.offer(
            "spooled", outgoing(message)
        ):
            self.counted["dropped"] += 1
            return False
        self.counted["unkept"] += 1
        return True

    # -- reports of the thread ------------------------------------------------

    def _kept(self, numbers: list[int]) -> None:
        kept = self._waiting.take(len(numbers))
        for entry, number in zip(kept, numbers, strict=True):
            self._kept_bytes += len(entry.payload)
            self.counted["kept"] += 1
            self._forwarder.feed.kept(stored_message_of(entry, number))

    def _failed(self, trouble: StorageError) -> None:
        log.debug("blocks not kept: %s", trouble.text)
        for entry, n_points in self._waiting.give_up():
            if not self._send_unkept(entry):
                self.taken_back(entry.session, n_points)

    def _changed(self, condition: StoreStatus) -> None:
        self._condition = condition
        self._kept_bytes = 0
        trouble = condition.trouble
        self._events.change(
            trouble is not None,
            "error",
            "scan.spool_failed",
            "scans are kept again"
            if trouble is None
            else f"scans are sent without having been kept: {trouble.text}",
            source="scan",
            remedy="" if trouble is None else trouble.remedy,
        )

    def _replaced(self, text: str) -> None:
        self._events.report("error", "scan.spool_replaced", text, source="scan")

    def _open(self) -> None:
        if self._starting is None:
            self._starting = asyncio.create_task(self._forwarder.open())
            self._starting.add_done_callback(self._opened)
            self._forwarder.feed.refill()

    def _opened(self, starting: asyncio.Task[None]) -> None:
        """Where it was refused, nothing is stored: a running daemon continues."""
        error = None if starting.cancelled() else starting.exception()
        if error is not None:
            self._changed(StoreStatus(StorageError(str(error), "see there")))
            self._failed(StorageError(str(error), ""))

    def _rules(self) -> RetentionRules:
        keep_mb = max(1.0, SENT_SHARE * self._section.spool_mb)
        section = OutboxSection(keep_days=self._section.spool_days, keep_mb=keep_mb)
        return RetentionRules(section, self._scan)
