"""Complete delivery of scans: each block is on the disk before it is sent.

A thread of its own writes to `scans.db`, a database like the outbox's, so that a slow
disk or an absent broker delays nothing else. Blocks go to the broker from memory while
it keeps up, else from the disk, in order; sent ones are kept for some time for
requests.

Blocks beyond `MAX_WAITING` on their way to the disk, or beyond a spool full of unsent
ones, are dropped newest first and counted, and show as a gap in the numbers. While the
disk refuses, blocks are sent without being stored.
"""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from traverse.daemon.config.schema import ScanSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.store.durable_queue import DurableQueue, QueueProfile
from traverse.daemon.store.forwarder import outgoing
from traverse.daemon.store.queries import block_id
from traverse.daemon.store.records import (
    NewMessage,
    PendingWrite,
    RetentionRules,
    StorageError,
    StoreStatus,
)
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Scan, SpoolHealth
from traverse.protocol.topics import scan_topic

MAX_WAITING = 200  # blocks on their way to the disk
SENT_SHARE = 0.8  # of the spool that blocks may fill which the broker has

PROFILE = QueueProfile(
    thread="scans",
    kind="spooled",
    source="scan",
    failed="scan.spool_failed",
    failed_text="scans are sent without having been kept: {}",
    restored_text="scans are kept again",
    replaced="scan.spool_replaced",
    damaged="scan.spool_damaged",
    replaced_remedy="check the disk",
    batch=20,  # ten megabytes at most
    resend_batch=20,
)


class ScanStore(DurableQueue):
    """Delivers scan blocks as configured.

    Args:
        path: of the database; created by the first scan that needs it.
        publisher: sends blocks that are not stored.
        section: how scans are delivered and kept.

    Attributes:
        counters: blocks `kept`, `unkept` (sent without being stored), `dropped`.
    """

    def __init__(
        self,
        path: Path,
        publisher: MessagePublisher,
        events: EventLog,
        section: ScanSection,
    ) -> None:
        super().__init__(
            path,
            PROFILE,
            publisher,
            events,
            retention=_retention(section),
            to_disk=Latencies(),
            to_broker=Latencies(),
        )
        self._topic = scan_topic(publisher.arm)
        self._section = section
        self._publisher = publisher
        self._scan, self._begun_ns, self._is_complete = "", 0, False
        self.counters: Counter[str] = Counter()

    @contextlib.asynccontextmanager
    async def running(self, *, is_needed: bool = False) -> AsyncIterator[None]:
        """Run, if there is something to send or store.

        Raises:
            DatabaseRefusedError: the database must be left alone.
        """
        is_needed |= self._section.delivery == "complete" or self.path.exists()
        async with super().running(is_needed=is_needed):
            yield

    def use(self, section: ScanSection) -> None:
        """Change the settings; a running scan is delivered as it began."""
        self._section = section
        self._writer.retention = _retention(section)

    def offer(
        self, block: Scan, on_dropped: Callable[[], object] = lambda: None
    ) -> bool:
        """Deliver a block; False if it is dropped.

        ``on_dropped`` is called if it is dropped later.
        """
        if block.scan != self._scan:
            self._scan, self._begun_ns = block.scan, block.time_ns
            self._is_complete = self._section.delivery == "complete"
        if not self._is_complete:
            return self._publisher.publish("scan", block)
        if self._starting is None:
            self.start().add_done_callback(self._on_started)
        is_taken = self._take(block, on_dropped)
        if is_taken:
            self._publisher.listener.published(self._clock.monotonic_ns(), block)
        return is_taken

    def health(self) -> SpoolHealth | None:
        """Return figures of the spool; None if none is used."""
        if not self.is_open:
            return None
        statistics = self.status.statistics
        return SpoolHealth(
            state="ready" if self.is_ready else "failed",
            blocks=statistics.points,
            unsent=statistics.unsent,
            bytes=statistics.size_bytes,
        )

    def _take(self, block: Scan, on_dropped: Callable[[], object]) -> bool:
        is_full = self.used_bytes >= self._section.spool_mb * 1e6
        self._report_full(is_full)
        if is_full or self.n_in_flight >= MAX_WAITING:
            self.counters["dropped"] += 1
            return False
        message = NewMessage(
            block.scan,
            block.seq,
            block_id(block),
            block.time_ns,
            self._topic,
            self._encoding,
            encode(block, self._encoding),
            self._begun_ns,
            block.session,
        )
        if not self.is_ready:
            return self._send_unkept(message)
        write = PendingWrite()

        def on_settled() -> None:
            if write.trouble is None:
                self.counters["kept"] += 1
            elif not self._send_unkept(message):
                on_dropped()

        write.on_settled(on_settled)
        self.put(message, write)
        return True

    def _report_full(self, is_full: bool) -> None:
        self._events.change(
            is_full,
            "error",
            "scan.spool_full",
            f"{self.path} holds {self._section.spool_mb:g} MB of scans that the "
            "broker lacks; further blocks are dropped"
            if is_full
            else "there is room for scans again",
            remedy="restore the broker, or raise spool_mb of [scan]" if is_full else "",
        )

    def _send_unkept(self, message: NewMessage) -> bool:
        """Send a block that the disk refuses, unless earlier ones wait there."""
        is_sent = not self.has_backlog and self._queue.offer(
            "spooled", outgoing(message)
        )
        self.counters["unkept" if is_sent else "dropped"] += 1
        return is_sent

    def _on_started(self, start: asyncio.Task[None]) -> None:
        """Store nothing if the start was refused; the daemon continues."""
        error = None if start.cancelled() else start.exception()
        if error is not None:
            trouble = StorageError(str(error), "see there")
            self._set_status(StoreStatus(trouble))
            self._fail(trouble)


def _retention(section: ScanSection) -> RetentionRules:
    keep_mb = max(1.0, SENT_SHARE * section.spool_mb)
    return RetentionRules(section.spool_days, keep_mb)
