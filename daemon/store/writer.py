"""The thread that writes to a store: takes jobs, returns results in order.

All waiting messages are written in one transaction, since syncing costs the same for
one as for a hundred. Bursts of points are collected for `COMMIT_INTERVAL_S`, since a
transaction costs as much CPU as several points. After a failed write later ones fail
too, until the loop knows of it: their numbers would follow numbers that were never
stored.
"""

import asyncio
import concurrent.futures
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import InitVar, dataclass
from pathlib import Path
from typing import Any

from traverse.daemon.clock import HostClock
from traverse.daemon.store.database import DAY_NS, MessageDatabase
from traverse.daemon.store.records import (
    Committed,
    DatabaseRefusedError,
    NewMessage,
    Notification,
    Removed,
    RetentionRules,
    StorageError,
    StoreStatus,
    WriteFailed,
)
from traverse.daemon.store.recovery import ResilientDatabase
from traverse.daemon.store.retention_clock import RetentionClock
from traverse.daemon.utc import as_text
from traverse.drivers.base.heartbeat import Heartbeat

log = logging.getLogger("traverse.daemon.outbox")

POLL_S = 0.5
STATUS_S = 1.0
DELETE_S = 0.3
REMOVED_S = 60.0  # from one report of what was removed to the next
MAX_BATCH = 500
COMMIT_INTERVAL_S = 0.002  # from the beginning of one transaction to the next
DELETE_BATCH = 50
TURN_S = 30.0  # that a slow disk may take


Job = NewMessage | Callable[[], None] | None
"""Store a message, run a call, or, for None, end."""


@dataclass(eq=False)
class StoreWriter:
    """Works through jobs and reports results to the loop.

    Args:
        notify: called on the loop with results, in order.

    Attributes:
        retention: may be replaced at any time.
        retention_clock: by which messages age.
    """

    path: InitVar[Path]
    name: InitVar[str]
    clock: HostClock
    retention: RetentionRules
    notify: Callable[[Notification], None]

    def __post_init__(self, path: Path, name: str) -> None:
        self._database = ResilientDatabase(
            path, lambda report: self._post(self.notify, report)
        )
        self._jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
        self._loop = asyncio.get_running_loop()
        self._status = StoreStatus()
        self._status_s = -STATUS_S
        self._has_failed = False
        self._committed_s = -COMMIT_INTERVAL_S
        self._running = ""  # the session of the latest message
        self._opened: concurrent.futures.Future[None] = concurrent.futures.Future()
        self.heartbeat = Heartbeat(f"thread of the {name}")
        self.retention_clock = RetentionClock(self.clock)
        self._removed, self._removed_s = 0, -REMOVED_S
        self._thread = threading.Thread(target=self._run, name=name)

    async def start(self) -> None:
        """Open the database, retrying failures that may pass.

        Raises:
            DatabaseRefusedError: it must be left alone.
        """
        self._thread.start()
        try:
            await asyncio.wrap_future(self._opened)
        except BaseException:
            self._jobs.put(None)
            raise

    async def close(self) -> None:
        """Do all jobs that were put, and end."""
        self._jobs.put(None)
        await asyncio.to_thread(self._thread.join)

    def write(self, message: NewMessage) -> None:
        self._jobs.put(message)

    def resume(self) -> None:
        """Store messages again, once the failed ones are accounted for."""

        def resume() -> None:
            self._has_failed = False

        self._jobs.put(resume)

    def query(
        self, work: Callable[[MessageDatabase], Any], on_result: Callable[[Any], None]
    ) -> None:
        """Run a job on the database; pass its result or exception on."""

        def run() -> None:
            try:
                result = self._database.run(work)
            except Exception as error:  # noqa: BLE001 - it reaches the asker
                result = error
            self._post(on_result, result)

        self._jobs.put(run)

    # -- on the thread --------------------------------------------------------

    def _run(self) -> None:
        self._opened.set_running_or_notify_cancel()  # nobody can cancel it any more
        try:
            self._database.open()
        except DatabaseRefusedError as error:
            self._opened.set_exception(error)
            return
        self._report_status()
        self._opened.set_result(None)
        waiting: deque[Job] = deque()
        checked_s = time.monotonic()
        while True:
            self.heartbeat.beat(TURN_S)
            self._take_all(waiting)
            while waiting:
                self.heartbeat.beat(TURN_S)
                job = waiting.popleft()
                if job is None:
                    self._database.close()
                    self.heartbeat.idle()
                    return
                if isinstance(job, NewMessage):
                    self._write(job, waiting)
                else:
                    job()
            if time.monotonic() - checked_s >= POLL_S:
                self._database.check()
                self._delete_old()
                checked_s = time.monotonic()
            self._report_status()

    def _take_all(self, waiting: deque[Job]) -> None:
        try:
            waiting.append(self._jobs.get(timeout=POLL_S))
            early_s = self._committed_s + COMMIT_INTERVAL_S - time.monotonic()
            if early_s > 0.0 and isinstance(waiting[0], NewMessage):
                time.sleep(early_s)
            while not self._jobs.empty():  # nobody else takes any
                waiting.append(self._jobs.get_nowait())
        except queue.Empty:
            return

    def _write(self, first: NewMessage, waiting: deque[Job]) -> None:
        messages = [first]
        while waiting and len(messages) < MAX_BATCH:
            if not isinstance(waiting[0], NewMessage):
                break
            messages.append(waiting[0])
            waiting.popleft()
        if self._has_failed:
            return
        self._committed_s = time.monotonic()
        try:
            numbers = self._database.add(messages)
        except Exception as error:  # noqa: BLE001 - reported as a trouble
            self._has_failed = True
            trouble = self._database.trouble or StorageError(repr(error), "")
            self._post(self.notify, WriteFailed(trouble))
        else:
            self._running = messages[-1].session
            self._post(self.notify, Committed(numbers))
        self._report_status()

    def _delete_old(self) -> None:
        """Delete old messages in small steps between jobs."""
        if self._database.trouble is not None:
            return
        rules, before_ns = self.retention, 0

        def step(store: MessageDatabase) -> int:
            nonlocal before_ns
            believed_ns = store.believed_ns(self.retention_clock.advanced)
            before_ns = max(0, believed_ns - int(rules.keep_days * DAY_NS))
            n = store.delete_old(
                before_ns=before_ns,
                keep_bytes=int(rules.keep_mb * 1e6),
                running=self._running,
                at_most=DELETE_BATCH,
            )
            store.trim_file()
            return n

        try:
            end_s = time.monotonic() + DELETE_S
            while (n := self._database.run(step)) and self._jobs.empty():
                self._removed += n
                if time.monotonic() > end_s:
                    return
            self._removed += n
            self._report_removed(before_ns)
        except Exception as error:  # noqa: BLE001 - it has been reported
            log.debug("nothing deleted: %s", error)

    def _report_removed(self, before_ns: int) -> None:
        now_s = time.monotonic()
        if self._removed and now_s - self._removed_s >= REMOVED_S:
            why = f"beyond {self.retention.keep_mb:g} MB"
            if before_ns:
                why = f"older than {as_text(before_ns)}, or {why}"
            self._post(self.notify, Removed(self._removed, why))
            self._removed, self._removed_s = 0, now_s

    def _report_status(self) -> None:
        """Report troubles at once, statistics at intervals."""
        is_new = self._database.trouble != self._status.trouble
        now_s = time.monotonic()
        if not is_new and now_s - self._status_s < STATUS_S:
            return
        status, self._status_s = self._database.status(), now_s
        if status != self._status:
            self._status = status
            self._post(self.notify, status)

    def _post(self, act: Callable[..., object], value: object) -> None:
        try:
            self._loop.call_soon_threadsafe(act, value)
        except RuntimeError:  # the loop has ended
            log.debug("nobody to notify: %s", value)
