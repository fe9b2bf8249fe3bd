"""The recorder: writes what measuring does to files, through one thread.

Notifications are only passed on; nothing waits. With room for no more, items are
dropped and counted, and the files note that something is missing.
"""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.measurement import Measurement
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import PointWriter
from traverse.daemon.recorder.file import Recorded
from traverse.daemon.recorder.flight import RecorderNotification
from traverse.daemon.recorder.item_queue import RecorderItem, RecorderQueue
from traverse.daemon.recorder.snapshot import DeviceSnapshot
from traverse.daemon.recorder.thread import RecorderThread, ThreadJobs
from traverse.daemon.step_listener import StepListener
from traverse.daemon.store.records import PendingWrite
from traverse.drivers.base.delivery_maps import delivery_kind
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Event, Message, Point
from traverse.protocol.messages.recording_health import RecordingHealth

SOURCE = "recording"
STATE_NS = 6_000_000_000
PATIENCE_NS = 3_000_000_000  # a state is recorded in a quiet moment, if there is one
AFTERMATH_NS = 2_000_000_000  # what follows a fault is kept with it
CALM_NS = 30_000_000_000  # after a file was kept, none is for so long
FAULTS = ("alarm.", "device.", "outbox.", "daemon.", "watchdog.", "realtime.")
"""Beginnings of the codes of errors that are faults."""


class FaultTrigger:
    """Note faults, and decide when to store what was before them."""

    def __init__(self) -> None:
        self._keep_at: tuple[int, str] | None = None
        self._calm_ns = 0

    def add(self, now_ns: int, event: Event) -> None:
        """An event is published."""
        is_fault = (
            event.severity == "error"
            and event.active is not False
            and event.code.startswith(FAULTS)
        )
        if is_fault and self._keep_at is None and now_ns >= self._calm_ns:
            self._keep_at = now_ns + AFTERMATH_NS, event.code

    def due(self, now_ns: int) -> str | None:
        """The code of a fault that is to be stored now; None: none."""
        if self._keep_at is None or now_ns < self._keep_at[0]:
            return None
        code, self._keep_at = self._keep_at[1], None
        self._calm_ns = now_ns + CALM_NS
        return code


class Recorder(StepListener):
    """Records; use it as an asynchronous context manager.

    Args:
        section: of the configuration.
        folder: of all recordings.
        clock: that of the steps.
        about: values for the head of every file.
        files: arm file, configuration and so on.
        events: receives what happens to recordings.

    Attributes:
        measurement: whose state is recorded; to be set before the first step.
    """

    def __init__(
        self,
        section: RecordingSection,
        *,
        folder: Path,
        clock: HostClock,
        about: Mapping[str, str],
        files: Mapping[str, bytes],
        events: EventLog,
    ) -> None:
        self._section = section
        self._events = events
        self._clock = clock
        self._queue = RecorderQueue()
        self._jobs = ThreadJobs(self._queue)
        self._faults = FaultTrigger()
        self._told = DeviceSnapshot()
        self.measurement: Measurement | None = None
        self._is_on = section.flight
        self._due_ns = 0
        self._missing = 0
        self._failed = ""
        self._thread = RecorderThread(
            self._queue,
            folder=folder,
            section=section,
            about=about,
            files=files,
            utc_offset_ns=clock.utc_offset_ns(),
            notify=self._on_notification,
        )

    @property
    def heartbeat(self) -> Heartbeat:
        """Signs of life of its thread."""
        return self._thread.heartbeat

    async def __aenter__(self) -> Self:
        self._thread.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._is_on = False
        self._jobs.submit(self._thread.end)
        await asyncio.to_thread(self._thread.join)

    # -- the tape -------------------------------------------------------------

    def delivered(self, now_ns: int, delivery: Delivery) -> None:
        """A device has delivered something."""
        self._look(now_ns)
        self._told.note(delivery)
        self._put(RecorderItem("delivered", now_ns, delivery_kind(delivery), delivery))

    def passed(self, now_ns: int) -> None:
        """Time has passed."""
        self._look(now_ns)
        self._put(RecorderItem("passed", now_ns))

    def asked(self, now_ns: int, what: str, values: Mapping[str, object]) -> None:
        """A request was executed."""
        self._look(now_ns)
        self._put(RecorderItem("asked", now_ns, what, dict(values)))

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """UTC is so much more than host monotonic time from now on."""
        self._put(RecorderItem("related", now_ns, value=utc_offset_ns))

    def published(self, now_ns: int, message: Message) -> None:
        """A message has been handed on to be published."""
        self._put(RecorderItem("published", now_ns, value=message))
        if isinstance(message, Event) and self._section.flight:
            self._faults.add(now_ns, message)

    def following(self, keep: PointWriter) -> PointWriter:
        """What sends points to the disk, followed: those that arrive are recorded."""

        def kept(point: Point, begun_ns: int, note: str) -> PendingWrite | None:
            keeping = keep(point, begun_ns, note)
            if keeping is not None:
                self._follow(keeping)
            return keeping

        return kept

    def _follow(self, keeping: PendingWrite) -> None:
        def settled() -> None:
            now_ns = self._clock.running.monotonic_ns()
            if keeping.trouble is None:
                self.published(now_ns, keeping.point)
            else:
                self._put(RecorderItem("asked", now_ns, "not_kept", {}))

        keeping.on_settled(settled)

    def reloaded(self, files: Mapping[str, bytes]) -> None:
        """Other files are in force from now on."""
        now_ns = self._clock.step()
        probe = None if self.measurement is None else self.measurement.probe_json
        self._put(
            RecorderItem("files", now_ns, value={"files": dict(files), "probe": probe})
        )
        self._due_ns = 0

    # -- recordings with a name -----------------------------------------------

    @property
    def running(self) -> str | None:
        """The name of what is being recorded; None without."""
        recorded = self._thread.recorded
        return None if recorded is None else recorded.name

    async def begin(self, name: str, note: str) -> Path:
        """Begin a recording; gives its path.

        Raises:
            OSError: it cannot be written.
        """
        path = await self._jobs.run(lambda: self._thread.begin(name, note))
        if not self._is_on:
            self._is_on, self._due_ns = True, 0
        text = f"{path} is being recorded"
        self._events.report("info", "recording.started", text, source=SOURCE)
        return path

    async def finish(self) -> Recorded:
        """End the recording; gives what it has become.

        Raises:
            OSError: there is none, or its end cannot be written.
        """
        recorded = await self._jobs.run(self._thread.finish)
        self._is_on = self._section.flight
        self._report_stopped(recorded, "it was asked for", by_itself=False)
        return recorded

    def health(self) -> RecordingHealth:
        """How it is, for the health message."""
        recorded, flight = self._thread.recorded, self._thread.flight
        return RecordingHealth(
            state=(
                "recording"
                if recorded
                else "failed"
                if self._failed
                else "flight"
                if self._section.flight
                else "off"
            ),
            name=recorded.name if recorded else None,
            bytes=recorded.n_bytes if recorded else 0,
            flight_bytes=flight.n_bytes,
            queued=len(self._queue),
            dropped=self._queue.dropped,
            kept=flight.kept,
            kept_dropped=flight.dropped,
        )

    def poll(self) -> None:
        """See whether a fault is to be kept, also where no device delivers any more."""
        self._keep_if_due(self._clock.running.monotonic_ns())

    # -- inside ---------------------------------------------------------------

    def _put(self, item: RecorderItem) -> None:
        if not self._is_on:
            return
        if self._missing:
            gap = RecorderItem("gap", item.at_ns, value={"missing": self._missing})
            if not self._queue.put(gap):
                self._missing += 1
                return
            self._missing = 0
            self._due_ns = 0
        if not self._queue.put(item):
            self._missing += 1
            self._events.report(
                "warning",
                "recording.overflow",
                "the disk does not keep up with what is to be recorded; a part of it "
                "is left out",
                source=SOURCE,
                remedy="record to a faster disk, or at a lower rate",
            )

    def _keep_if_due(self, now_ns: int) -> None:
        why = self._faults.due(now_ns)
        if why is not None:
            self._jobs.submit(lambda: self._thread.keep(why))

    def _look(self, now_ns: int) -> None:
        """Before a step: write the state or store the past, if due."""
        self._keep_if_due(now_ns)
        if not self._is_on or now_ns < self._due_ns or self.measurement is None:
            return
        is_patient = self._due_ns and now_ns < self._due_ns + PATIENCE_NS
        if is_patient and not self.measurement.is_quiet:
            return
        self._due_ns = now_ns + STATE_NS
        told = self._told.maps()
        devices = {"devices": told, "fresh": not told}
        state = {**self.measurement.snapshot(), **devices}
        self._put(RecorderItem("state", now_ns, value=state))

    def _on_notification(self, notification: RecorderNotification) -> None:
        """Called by the thread."""
        self._jobs.call_on_loop(lambda: self._handle(notification))

    def _handle(self, notification: RecorderNotification) -> None:
        reason = notification.flight_failed
        if reason is not None:
            self._failed = reason
            self._due_ns = 0
            self._events.change(
                bool(reason),
                "error",
                "recording.failed",
                f"the flight recorder cannot write: {reason}"
                if reason
                else "the flight recorder tries again",
                source=SOURCE,
                remedy="make room on the disk; measuring goes on without it",
            )
        if notification.kept is not None:
            text = f"the last minutes are kept in {notification.kept}"
            self._events.report(
                "info", "recording.kept", text, source=SOURCE, distinct=True
            )
        if notification.stopped is not None:
            self._is_on = self._section.flight
            self._report_stopped(*notification.stopped, by_itself=True)

    def _report_stopped(
        self, recorded: Recorded | None, why: str, *, by_itself: bool
    ) -> None:
        what = "the recording" if recorded is None else str(recorded.path)
        remedy = "what is in it can be read; make room, then record again"
        self._events.report(
            "error" if by_itself else "info",
            "recording.stopped",
            f"{what} has ended: {why}",
            source=SOURCE,
            remedy=remedy if by_itself else "",
            distinct=True,
        )
