"""The one thread that writes to the outbox: takes jobs, returns results in order.

All waiting points are written in one transaction: syncing takes as long for a hundred
as for one. Points that arrive faster than hands can press are collected for
`COMMIT_INTERVAL_S`, since a transaction costs as much CPU as several points. After a
write has failed, later points fail, too, until the loop knows of it: their numbers
would follow numbers that were never stored.
"""

import asyncio
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from traverse.daemon.clock import HostClock
from traverse.daemon.store.database import DAY_NS, MessageDatabase
from traverse.daemon.store.records import (
    Job,
    NewMessage,
    QueryJob,
    RetentionRules,
    StorageError,
    StoreRefusedError,
    StoreStatus,
    WriteJob,
)
from traverse.daemon.store.recovery import ResilientDatabase
from traverse.drivers.base.heartbeat import Heartbeat

log = logging.getLogger("traverse.daemon.outbox")

LOOK_S = 0.5
FIGURES_S = 0.2
FORGET_S = 0.3
MAX_BATCH = 500
COMMIT_INTERVAL_S = 0.002  # from the beginning of one transaction to the next
DELETE_BATCH = 50
TURN_S = 30.0  # that a slow disk may take


class StoreWriter:
    """Work through jobs, and report the results to the loop.

    Args:
        path: of the database.
        clock: the host's.
        rules: what may be deleted.
        kept: called with the numbers of points that are safe now, in order.
        failed: called with the generation of which no more points will be stored.
        changed: called with the state of the outbox when it changes.
        replaced: called with a text when a new database has been begun.
        name: of the thread.

    Attributes:
        heartbeat: the thread's signs of life.
    """

    def __init__(
        self,
        path: Path,
        clock: HostClock,
        rules: RetentionRules,
        *,
        kept: Callable[[list[int]], None],
        failed: Callable[[int, StorageError], None],
        changed: Callable[[StoreStatus], None],
        replaced: Callable[[str], None],
        name: str = "outbox",
    ) -> None:
        self._clock = clock
        self._rules = rules
        self._kept = kept
        self._failed = failed
        self._changed = changed
        self._database = ResilientDatabase(
            path, lambda text: self._tell(replaced, text)
        )
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._loop = asyncio.get_running_loop()
        self._told = StoreStatus()
        self._told_s = -FIGURES_S
        self._failed_generation = -1
        self._kept_s = -COMMIT_INTERVAL_S
        self._opened: asyncio.Future[None] = self._loop.create_future()
        self.heartbeat = Heartbeat(f"thread of the {name}")
        self._thread = threading.Thread(target=self._run, name=name)

    async def start(self) -> None:
        """Open the database; where that fails for now, it is tried again and again.

        Raises:
            StoreRefusedError: it must be left alone.
        """
        self._thread.start()
        try:
            await self._opened
        except BaseException:
            self._jobs.put(None)
            raise

    async def close(self) -> None:
        """Do all jobs that have been put, and end."""
        self._jobs.put(None)
        await asyncio.to_thread(self._thread.join)

    def put(self, job: Job) -> None:
        """Have something done, after all that was put before."""
        self._jobs.put(job)

    def query(
        self,
        work: Callable[[MessageDatabase], Any],
        on_result: Callable[[Any], None],
    ) -> None:
        """Do something with the database; pass on the result, or the exception."""
        self._jobs.put(QueryJob(work, on_result))

    def _begun(self, error: StoreRefusedError | None) -> None:
        if self._opened.done():  # no requester waits any more
            return
        if error is None:
            self._opened.set_result(None)
        else:
            self._opened.set_exception(error)

    # -- on the thread --------------------------------------------------------

    def _run(self) -> None:
        try:
            self._database.open()
        except StoreRefusedError as error:
            self._tell(self._begun, error)
            return
        self._look()
        self._tell(self._begun, None)
        waiting: deque[Job | None] = deque()
        looked_s = time.monotonic()
        while True:
            self.heartbeat.beat(TURN_S)
            self._take_all(waiting)
            while waiting:
                self.heartbeat.beat(TURN_S)
                if waiting[0] is None:
                    self._database.close()
                    self.heartbeat.idle()
                    return
                self._do_next(waiting)
            if time.monotonic() - looked_s >= LOOK_S:
                self._database.look()
                self._forget()
                looked_s = time.monotonic()
            self._look()

    def _take_all(self, waiting: deque[Job | None]) -> None:
        """Wait for a job, then take all that are there."""
        try:
            waiting.append(self._jobs.get(timeout=LOOK_S))
            early_s = self._kept_s + COMMIT_INTERVAL_S - time.monotonic()
            if early_s > 0.0 and isinstance(waiting[0], WriteJob):
                time.sleep(early_s)
            while True:
                waiting.append(self._jobs.get_nowait())
        except queue.Empty:
            return

    def _do_next(self, waiting: deque[Job | None]) -> None:
        match waiting[0]:
            case WriteJob(generation):
                entries: list[NewMessage] = []
                while (
                    waiting
                    and isinstance(job := waiting[0], WriteJob)
                    and job.generation == generation
                    and len(entries) < MAX_BATCH
                ):
                    entries.append(job.entry)
                    waiting.popleft()
                self._keep(generation, entries)
            case QueryJob(work, told):
                waiting.popleft()
                try:
                    result = self._database.use(work)
                except Exception as error:  # noqa: BLE001 - it reaches the asker
                    result = error
                self._tell(told, result)
            case RetentionRules() as rules:
                waiting.popleft()
                self._rules = rules

    def _keep(self, generation: int, entries: list[NewMessage]) -> None:
        if generation <= self._failed_generation:
            return
        self._kept_s = time.monotonic()
        try:
            numbers = self._database.add(entries)
        except Exception as error:  # noqa: BLE001 - reported as a trouble
            self._failed_generation = generation
            trouble = self._database.trouble or StorageError(repr(error), "")
            self._tell(self._failed, generation, trouble)
        else:
            self._tell(self._kept, numbers)
        self._look()

    def _forget(self) -> None:
        """Remove what need not be kept any longer, in small steps between jobs."""
        if self._database.trouble is not None:
            return
        section = self._rules.section
        now_ns = self._clock.to_utc_ns(self._clock.monotonic_ns())

        def step(store: MessageDatabase) -> int:
            n = store.forget(
                before_ns=now_ns - int(section.keep_days * DAY_NS),
                keep_bytes=int(section.keep_mb * 1e6),
                running=self._rules.running,
                at_most=DELETE_BATCH,
            )
            store.trim_file()
            return n

        try:
            end_s = time.monotonic() + FORGET_S
            while self._database.use(step) and self._jobs.empty():
                if time.monotonic() > end_s:
                    return
        except Exception as error:  # noqa: BLE001 - it has been reported
            log.debug("nothing deleted: %s", error)

    def _look(self) -> None:
        """Report the outbox's state: troubles at once, figures regularly."""
        trouble, now_s = self._database.trouble, time.monotonic()
        if trouble == self._told.trouble and now_s - self._told_s < FIGURES_S:
            return
        self._database.count()
        condition, self._told_s = StoreStatus(trouble, self._database.figures), now_s
        if condition != self._told:
            self._told = condition
            self._tell(self._changed, condition)

    def _tell(self, told: Callable[..., object], *values: object) -> None:
        try:
            self._loop.call_soon_threadsafe(told, *values)
        except RuntimeError:  # the loop has ended
            log.debug("nobody to notify: %s", values)
