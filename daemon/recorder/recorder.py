"""The recorder: writes the steps of a measurement to files, in one thread.

`StepRecorder` only queues its notifications. Items beyond the bound are dropped
and counted, and the files state the gap. `Recorder` owns the thread, begins and ends
recordings and reports on them.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Literal

from traverse.daemon.clock import HostClock
from traverse.daemon.command_handlers import handles
from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import PointWriter
from traverse.daemon.recorder.file import Recorded
from traverse.daemon.recorder.item_queue import RecorderItem, RecorderQueue
from traverse.daemon.recorder.thread import RecorderThread
from traverse.daemon.step_listener import StateSource, StepListener
from traverse.daemon.store.records import PendingPoint
from traverse.drivers.base.delivery_maps import delivery_kind, delivery_to_map
from traverse.drivers.base.values import (
    Delivery,
    DeviceAlarm,
    DeviceClockState,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    StreamStarted,
)
from traverse.protocol.messages import Event, Message, Point, RecordArgs
from traverse.protocol.messages.health import RecordingHealth

STATE_NS = 6_000_000_000
PATIENCE_NS = 3_000_000_000  # a snapshot is taken at a quiet moment, if there is one
AFTERMATH_NS = 2_000_000_000  # what follows a fault is kept with it
CALM_NS = 30_000_000_000  # after a file was kept, none is for so long
FAULTS = ("alarm.", "device.", "outbox.", "daemon.", "watchdog.", "realtime.")
"""Prefixes of error codes that count as faults."""


class DeviceSnapshot:
    """Deliveries that give the devices' current state, for later recordings."""

    def __init__(self) -> None:
        self._latest: dict[str, dict[object, Delivery]] = {}

    def note(self, delivery: Delivery) -> None:
        latest = self._latest.setdefault(delivery.device, {})
        match delivery:
            case DeviceUp():
                latest.clear()
                latest["up"] = delivery
            case (
                DeviceLost()
                | StreamStarted()
                | DeviceTemperatures()
                | DeviceClockState()
            ):
                kind = delivery_kind(delivery)
                latest.pop(kind, None)
                latest[kind] = delivery
            case DeviceAlarm():
                alarm = ("alarm", delivery.channel, delivery.code)
                latest.pop(alarm, None)
                if delivery.raised:
                    latest[alarm] = delivery

    def maps(self) -> list[dict[str, object]]:
        tables = []
        for latest in self._latest.values():
            for delivery in latest.values():
                table = delivery_to_map(delivery)
                if isinstance(delivery, DeviceUp):
                    table["restarted"] = False  # what it made is in the state already
                tables.append(table)
        return tables


class StepRecorder(StepListener):
    """Queues all steps and messages for the recorder thread, while it is on.

    Args:
        flight: the flight recorder is configured; otherwise it begins switched off.
    """

    def __init__(self, clock: HostClock, *, flight: bool) -> None:
        self._clock = clock
        self._flight = flight
        self._keep_at: tuple[int, str] | None = None  # a fault, when it is stored
        self._calm_ns = 0
        self._devices = DeviceSnapshot()
        self._due_ns = 0
        self._missing = 0
        self.queue = RecorderQueue()
        self.is_on = flight

    def delivered(self, now_ns: int, delivery: Delivery, state: StateSource) -> None:
        self._before_step(now_ns, state)
        self._devices.note(delivery)
        self._put(RecorderItem("delivered", now_ns, delivery_kind(delivery), delivery))

    def passed(self, now_ns: int, state: StateSource) -> None:
        self._before_step(now_ns, state)
        self._put(RecorderItem("passed", now_ns))

    def asked(
        self,
        now_ns: int,
        command: str,
        values: Mapping[str, object],
        state: StateSource,
    ) -> None:
        self._before_step(now_ns, state)
        self._put(RecorderItem("asked", now_ns, command, dict(values)))

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        self._put(RecorderItem("related", now_ns, value=utc_offset_ns))

    def published(self, now_ns: int, message: Message) -> None:
        self._put(RecorderItem("published", now_ns, value=message))
        if not (isinstance(message, Event) and self._flight):
            return
        is_bad = message.severity == "error" and message.active is not False
        is_calm = self._keep_at is None and now_ns >= self._calm_ns
        if is_bad and is_calm and message.code.startswith(FAULTS):
            self._keep_at = now_ns + AFTERMATH_NS, message.code

    def following(self, write: PointWriter) -> PointWriter:
        """Wrap a writer so that points are recorded when they are on the disk."""

        def write_and_follow(
            point: Point, begun_ns: int, note: str
        ) -> PendingPoint | None:
            pending = write(point, begun_ns, note)
            if pending is not None:
                pending.on_settled(lambda: self._settled(pending))
            return pending

        return write_and_follow

    def reloaded(
        self, now_ns: int, files: Mapping[str, bytes], probe: str | None
    ) -> None:
        """Record that other files are in force, with this probe of the library."""
        value = {"files": dict(files), "probe": probe}
        self._put(RecorderItem("files", now_ns, value=value))
        self.request_state()

    def request_state(self) -> None:
        self._due_ns = 0

    def keep_if_due(self, now_ns: int) -> None:
        if self._keep_at is None or now_ns < self._keep_at[0]:
            return
        code, self._keep_at = self._keep_at[1], None
        self._calm_ns = now_ns + CALM_NS
        self.queue.put(RecorderItem("keep", now_ns, code))
        self.queue.wake()

    def _settled(self, pending: PendingPoint) -> None:
        now_ns = self._clock.monotonic_ns()
        if pending.trouble is None:
            self.published(now_ns, pending.point)
        else:
            self._put(RecorderItem("asked", now_ns, "not_kept", {}))

    def _put(self, item: RecorderItem) -> None:
        if not self.is_on:
            return
        if self._missing:
            gap = RecorderItem("gap", item.at_ns, value={"missing": self._missing})
            if not self.queue.put(gap):
                self._missing += 1
                return
            self._missing = 0
            self.request_state()
        if not self.queue.put(item):
            self._missing += 1

    def _before_step(self, now_ns: int, state: StateSource) -> None:
        """Record a snapshot, or keep the time before a fault, if due."""
        self.keep_if_due(now_ns)
        if not self.is_on or now_ns < self._due_ns:
            return
        is_patient = self._due_ns and now_ns < self._due_ns + PATIENCE_NS
        if is_patient and not state.is_quiet:
            return
        self._due_ns = now_ns + STATE_NS
        devices = self._devices.maps()
        snapshot = {**state.snapshot(), "devices": devices, "fresh": not devices}
        self._put(RecorderItem("state", now_ns, value=snapshot))


class Recorder:
    """Writes recordings: the flight recorder's and named ones."""

    def __init__(
        self,
        section: RecordingSection,
        steps: StepRecorder,
        *,
        folder: Path,
        clock: HostClock,
        about: Mapping[str, str],
        files: Mapping[str, bytes],
        events: EventLog,
    ) -> None:
        self._section = section
        self._steps = steps
        self._events = events
        self._clock = clock
        self._failed = ""
        self._n_dropped = 0  # so far reported
        self._thread = RecorderThread(
            steps.queue,
            folder=folder,
            section=section,
            about=about,
            files=files,
            utc_offset_ns=clock.utc_offset_ns(),
            on_flight_failure=self._report_flight,
            on_kept=self._report_kept,
            on_stopped=self._handle_stopped,
        )
        self.heartbeat = self._thread.heartbeat

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        self._thread.start()
        try:
            yield
        finally:
            self._steps.is_on = False
            self._thread.submit(self._thread.end)
            await asyncio.to_thread(self._thread.join)

    # -- recordings with a name -----------------------------------------------

    @property
    def name_in_use(self) -> str | None:
        recorded = self._thread.recorded
        return None if recorded is None else recorded.name

    @handles(RecordArgs)
    async def carry_out(self, args: RecordArgs) -> Result:
        """Start or stop a recording; return its file, and at the end its length.

        Raises:
            RequestRefusedError: it cannot be written, another one runs, or none does.
        """
        if args.action == "start" and self.name_in_use is not None:
            raise RequestRefusedError(
                "recording.busy",
                f"{self.name_in_use!r} is being recorded",
                "stop it first; there is one recording at a time",
            )
        if args.action == "stop" and self.name_in_use is None:
            raise RequestRefusedError(
                "recording.none",
                "nothing is being recorded",
                "it may have ended by itself: see the events recording.stopped",
            )
        try:
            if args.action == "start":
                path = await self.begin(args.name or "", args.note or "")
                return {"name": args.name or "", "file": str(path)}
            recorded = await self.finish()
        except OSError as error:
            raise RequestRefusedError(
                "recording.failed",
                f"the recording cannot be written: {error.strerror or error}",
                "make room on the daemon's disk, or use another name",
            ) from error
        return {
            "name": recorded.name,
            "file": str(recorded.path),
            "bytes": recorded.n_bytes,
            "messages": recorded.messages,
            "seconds": recorded.seconds,
            "gaps": recorded.gaps,
        }

    async def begin(self, name: str, note: str) -> Path:
        """Begin a recording; return its path.

        Raises:
            OSError: it cannot be written.
        """
        path = await self._thread.call(lambda: self._thread.begin(name, note))
        if not self._steps.is_on:
            self._steps.is_on = True
            self._steps.request_state()
        text = f"{path} is being recorded"
        self._events.report("info", "recording.started", text)
        return path

    async def finish(self) -> Recorded:
        """End the recording; return its figures.

        Raises:
            OSError: there is none, or its end cannot be written.
        """
        recorded = await self._thread.call(self._thread.finish)
        self._steps.is_on = self._section.flight
        self._report_stopped(recorded, "as requested", by_itself=False)
        return recorded

    def health(self) -> RecordingHealth:
        recorded, flight = self._thread.recorded, self._thread.flight
        state: Literal["off", "flight", "recording", "failed"] = "off"
        if recorded or self._failed:
            state = "recording" if recorded else "failed"
        elif self._section.flight:
            state = "flight"
        return RecordingHealth(
            state=state,
            name=recorded.name if recorded else None,
            bytes=recorded.n_bytes if recorded else 0,
            flight_bytes=flight.n_bytes,
            queued=len(self._steps.queue),
            dropped=self._steps.queue.dropped,
            kept=flight.kept,
            kept_dropped=flight.dropped,
        )

    def poll(self) -> None:
        """Keep the time before a fault even without deliveries; report losses."""
        self._steps.keep_if_due(self._clock.running.monotonic_ns())
        n_dropped = self._steps.queue.dropped
        if n_dropped > self._n_dropped:
            self._events.report(
                "warning",
                "recording.overflow",
                "the disk does not keep up with what is to be recorded; a part of it "
                "is left out",
                remedy="record to a faster disk, or at a lower rate",
                count=n_dropped - self._n_dropped,
            )
            self._n_dropped = n_dropped

    def _report_flight(self, reason: str) -> None:
        self._failed = reason
        self._steps.request_state()
        self._events.change(
            bool(reason),
            "error",
            "recording.failed",
            f"the flight recorder cannot write: {reason}"
            if reason
            else "the flight recorder tries again",
            remedy="free space on the disk, or make the folder one that can be "
            "written; measuring continues without it",
        )

    def _report_kept(self, path: Path) -> None:
        text = f"the last minutes are kept in {path}"
        self._events.report("info", "recording.kept", text, distinct=True)

    def _handle_stopped(self, recorded: Recorded | None, why: str) -> None:
        self._steps.is_on = self._section.flight
        self._report_stopped(recorded, why, by_itself=True)

    def _report_stopped(
        self, recorded: Recorded | None, why: str, *, by_itself: bool
    ) -> None:
        recording = "the recording" if recorded is None else str(recorded.path)
        remedy = "what is in it can be read; make room, then record again"
        self._events.report(
            "error" if by_itself else "info",
            "recording.stopped",
            f"{recording} has ended: {why}",
            remedy=remedy if by_itself else "",
            distinct=True,
        )
