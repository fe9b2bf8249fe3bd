"""Scans that are delivered completely: each block is on the disk before it is sent.

On the event loop; a thread of its own writes to `scans.db`, a database like the
outbox's, so a slow disk or an absent broker delays nothing else. Blocks go to the
broker from memory while it keeps up, else from the disk, in order; what it has taken is
kept for some time, so that it can be asked for again.

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

from daemon.clock import HostClock
from daemon.events import EventLog
from daemon.latencies import Latencies
from daemon.outbox_feed import OutboxFeed, Told, Work, outgoing
from daemon.outbox_jobs import Ask, Condition, Keep, Rules
from daemon.outbox_marks import OutboxMarks, Range
from daemon.outbox_resend import OutboxResend
from daemon.outbox_section import OutboxSection
from daemon.outbox_thread import OutboxThread
from daemon.outbox_values import (
    Entry,
    OutboxRefusedError,
    Trouble,
    held_of,
)
from daemon.outgoing import OutgoingQueue
from daemon.outlet import Outlet
from daemon.scan_again import ScanAgain
from daemon.scan_reading import block_id
from daemon.scan_section import ScanSection
from drivers.pulse import Pulse
from protocol.encoding import Encoding, encode
from protocol.messages import Scan, SpoolHealth
from protocol.topics import scan_topic

log = logging.getLogger("daemon.scans")

MAX_WAITING = 200  # blocks on their way to the disk
TOGETHER = 20  # blocks read at once: ten megabytes at most
SENT_SHARE = 0.8  # of the spool that blocks may fill which the broker has


class ScanSpool:
    """Delivers the blocks of scans, as the configuration says.

    Args:
        path: of the database; made when the first scan needs it.
        arm: name of the arm, for the topic.
        encoding: of the payloads.
        clock: the host's.
        section: how scans are delivered, and what of them is kept.
        outlet: for blocks that are not kept.
        queue: of what is to be published.
        events: where troubles are told.

    Attributes:
        again: sends blocks again, and tells what there is.
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
        outlet: Outlet,
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
        self._generation = 0
        self._condition = Condition()
        self._waiting: deque[tuple[Entry, int]] = deque()  # and how many points
        self._kept_bytes = 0  # since the condition was told
        self._emptied = asyncio.Event()
        self.counted: Counter[str] = Counter()
        self.use(section)
        self._rules = self._rules_now()
        self._thread = OutboxThread(
            path,
            clock,
            self._rules,
            kept=self._kept,
            failed=self._failed,
            changed=self._changed,
            replaced=self._replaced,
            name="scans",
        )
        self._marks = OutboxMarks(self._write_marks)
        self._feed = OutboxFeed(
            queue,
            self._ask,
            self._marks.add,
            clock,
            Latencies(),
            kind="spooled",
            together=TOGETHER,
        )
        self._again = OutboxResend(queue, self._ask, TOGETHER)
        self.again = ScanAgain(self._again, lambda: self._is_open)

    @property
    def pulses(self) -> tuple[Pulse, ...]:
        """Signs of life of its thread, while there is one."""
        return (self._thread.pulse,) if self._is_open else ()

    @property
    def _is_open(self) -> bool:
        return self._starting is not None

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Deliver while the block lasts; first what an earlier run has left.

        Raises:
            OutboxRefusedError: the database must be left alone.
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
                self._marks.flush()
                with contextlib.suppress(OutboxRefusedError):
                    await self._starting
                    await self._thread.close()

    async def idle(self) -> None:
        """Wait until no block is on its way to the disk."""
        while self._waiting:
            self._emptied.clear()
            await self._emptied.wait()

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
            self._outlet.tape.published(self._clock.monotonic_ns(), block)
        return is_taken

    def keep_house(self) -> None:
        """Go on with what has been put off; call it a few times a second."""
        if not self._is_open:
            return
        rules = self._rules_now()
        if rules != self._rules:
            self._rules = rules
            self._thread.put(rules)
        self._marks.flush()
        self.refill()

    def refill(self) -> None:
        """Read on, where there is something to read and room for it."""
        if self._is_open:
            self._feed.refill()
            self._again.refill()

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
        self._events.change(
            is_full,
            "error",
            "scan.spool_full",
            f"{self._path} holds {self._section.spool_mb:g} MB of scans that the "
            "broker lacks; further blocks are dropped"
            if is_full
            else "there is room for scans again",
            source="scan",
            remedy="bring the broker back, or raise spool_mb of [scan]"
            if is_full
            else "",
        )
        if is_full or len(self._waiting) >= MAX_WAITING:
            self.counted["dropped"] += 1
            return False
        entry = Entry(
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
        self._waiting.append((entry, len(block.dtime_ns)))
        self._thread.put(Keep(self._generation, entry))
        return True

    def _is_full(self) -> bool:
        waiting = sum(len(entry.payload) for entry, _ in self._waiting)
        used_bytes = self._condition.figures.used_bytes + self._kept_bytes
        return used_bytes + waiting >= self._section.spool_mb * 1e6

    def _send_unkept(self, entry: Entry) -> bool:
        """Send what the disk refuses, unless earlier blocks wait there."""
        message = held_of(entry, 0)
        if self._feed.is_behind or not self._queue.offer("spooled", outgoing(message)):
            self.counted["dropped"] += 1
            return False
        self.counted["unkept"] += 1
        return True

    # -- what the thread tells ------------------------------------------------

    def _kept(self, numbers: list[int]) -> None:
        for number in numbers:
            entry, _ = self._waiting.popleft()
            self._kept_bytes += len(entry.payload)
            self.counted["kept"] += 1
            self._feed.kept(held_of(entry, number))
        self._emptied.set()

    def _failed(self, generation: int, trouble: Trouble) -> None:
        log.debug("blocks not kept: %s", trouble.text)
        self._generation = generation + 1
        failed, self._waiting = self._waiting, deque()
        for entry, n_points in failed:
            if not self._send_unkept(entry):
                self.taken_back(entry.session, n_points)
        self._emptied.set()

    def _changed(self, condition: Condition) -> None:
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
        self._feed.look_again()

    # -- what the thread is asked ---------------------------------------------

    def _open(self) -> None:
        if self._starting is None:
            self._starting = asyncio.create_task(self._thread.start())
            self._starting.add_done_callback(self._opened)
            self._feed.refill()

    def _opened(self, starting: asyncio.Task[None]) -> None:
        """Where it was refused, nothing is kept: a running daemon goes on."""
        error = None if starting.cancelled() else starting.exception()
        if error is not None:
            self._changed(Condition(Trouble(str(error), "see there")))
            self._failed(self._generation, Trouble(str(error), ""))

    def _rules_now(self) -> Rules:
        keep_mb = max(1.0, SENT_SHARE * self._section.spool_mb)
        section = OutboxSection(keep_days=self._section.spool_days, keep_mb=keep_mb)
        return Rules(section, self._scan)

    def _ask(self, work: Work, told: Told) -> None:
        self._thread.put(Ask(work, told))

    def _write_marks(self, ranges: list[Range], told: Told) -> None:
        self._ask(lambda store: store.mark_sent(ranges), told)
