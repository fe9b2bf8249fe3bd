"""The recorder: what measuring does goes to files, by way of one thread.

What is told here is only handed on; nothing waits. With room for no more, items are
dropped and counted, and the files say that something is missing.
"""

import asyncio
import contextlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from daemon.clock import HostClock
from daemon.events import EventLog
from daemon.outbox_keeping import Keeping
from daemon.recorder_named import Recorded
from daemon.recorder_queue import Item, RecorderQueue
from daemon.recorder_state import LastTold, MeasuringState
from daemon.recorder_thread import RecorderThread, Told
from daemon.recording_section import RecordingSection
from daemon.sessions import Session
from daemon.tape import Tape
from drivers.delivery_maps import kind_of
from drivers.pulse import Pulse
from drivers.values import Delivery
from protocol.messages import Event, Message, Point
from protocol.messages.recording_health import RecordingHealth

STATE_NS = 6_000_000_000
PATIENCE_NS = 3_000_000_000  # a state is told of a quiet moment, if one comes
AFTERMATH_NS = 2_000_000_000  # what follows a fault is kept with it
CALM_NS = 30_000_000_000  # after a file was kept, none is for so long
FAULTS = ("alarm.", "device.", "outbox.", "daemon.", "watchdog.", "realtime.")
"""Beginnings of the codes of errors after which the last minutes are kept."""

T = TypeVar("T")
Keep = Callable[[Session, Point], Keeping | None]


class Recorder(Tape):
    """Records; use it as an asynchronous context manager.

    Args:
        section: of the configuration.
        folder: of all recordings.
        clock: that of the steps.
        about: what the head of every file says.
        files: arm file, configuration and so on.
        events: where it is told what happens to recordings.

    Attributes:
        state: says how measuring is; to be set before the first step.
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
        self._loop = asyncio.get_running_loop()
        self._queue = RecorderQueue()
        self._told = LastTold()
        self.state: MeasuringState | None = None
        self._is_on = section.flight
        self._due_ns = 0
        self._missing = 0
        self._keep_at: tuple[int, str] | None = None
        self._calm_ns = 0
        self._failed = ""
        self._thread = RecorderThread(
            self._queue,
            folder=folder,
            section=section,
            about=about,
            files=files,
            utc_offset_ns=clock.utc_offset_ns(),
            tell=self._hear,
        )

    @property
    def pulse(self) -> Pulse:
        """Signs of life of its thread."""
        return self._thread.pulse

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
        self._do(self._thread.end)
        await asyncio.to_thread(self._thread.join)

    # -- the tape -------------------------------------------------------------

    def delivered(self, now_ns: int, delivery: Delivery) -> None:
        """A device has delivered something."""
        self._look(now_ns)
        self._told.note(delivery)
        self._put(Item("delivered", now_ns, kind_of(delivery), delivery))

    def passed(self, now_ns: int) -> None:
        """Time has passed."""
        self._look(now_ns)
        self._put(Item("passed", now_ns))

    def asked(self, now_ns: int, what: str, values: Mapping[str, object]) -> None:
        """Somebody has asked for something."""
        self._look(now_ns)
        if what == "probe" and self.state is not None:
            self.state.probe = str(values["probe"])
        self._put(Item("asked", now_ns, what, dict(values)))

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """UTC is so much more than host monotonic time from now on."""
        self._put(Item("related", now_ns, value=utc_offset_ns))

    def published(self, now_ns: int, message: Message) -> None:
        """A message has been handed on to be published."""
        self._put(Item("published", now_ns, value=message))
        if isinstance(message, Event) and _is_fault(message):
            self._note_fault(now_ns, message.code)

    def following(self, keep: Keep) -> Keep:
        """What sends points to the disk, followed: those that arrive are recorded."""

        def kept(session: Session, point: Point) -> Keeping | None:
            keeping = keep(session, point)
            if keeping is not None:
                self._follow(keeping)
            return keeping

        return kept

    def _follow(self, keeping: Keeping) -> None:

        def settled() -> None:
            now_ns = self._clock.running.monotonic_ns()
            if keeping.trouble is None:
                self.published(now_ns, keeping.point)
            else:
                self._put(Item("asked", now_ns, "not_kept", {}))

        keeping.when_settled(settled)

    def reloaded(self, files: Mapping[str, bytes]) -> None:
        """Other files are in force from now on."""
        now_ns = self._clock.step()
        probe = None if self.state is None else self.state.probe
        self._put(Item("files", now_ns, value={"files": dict(files), "probe": probe}))
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
        path = await self._done(lambda: self._thread.begin(name, note))
        if not self._is_on:
            self._is_on, self._due_ns = True, 0
        text = f"{path} is being recorded"
        self._events.report("info", "recording.started", text, source="recording")
        return path

    async def finish(self) -> Recorded:
        """End the recording; gives what it has become.

        Raises:
            OSError: there is none, or its end cannot be written.
        """
        recorded = await self._done(self._thread.finish)
        self._is_on = self._section.flight
        self._tell_stopped(recorded, "it was asked for")
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

    # -- inside ---------------------------------------------------------------

    def _put(self, item: Item) -> None:
        if not self._is_on:
            return
        if self._missing:
            gap = Item("gap", item.at_ns, value={"missing": self._missing})
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
                source="recording",
                remedy="record to a faster disk, or at a lower rate",
            )

    def _look(self, now_ns: int) -> None:
        """Before a step: is it time to tell the state, or to keep what was?"""
        if self._keep_at is not None and now_ns >= self._keep_at[0]:
            why, self._keep_at = self._keep_at[1], None
            self._calm_ns = now_ns + CALM_NS
            self._do(lambda: self._thread.keep(why))
        if not self._is_on or now_ns < self._due_ns or self.state is None:
            return
        is_patient = self._due_ns and now_ns < self._due_ns + PATIENCE_NS
        if is_patient and not self.state.is_idle:
            return
        self._due_ns = now_ns + STATE_NS
        told = self._told.maps()
        state = {**self.state.state(), "devices": told, "fresh": not told}
        self._put(Item("state", now_ns, value=state))

    def _note_fault(self, now_ns: int, code: str) -> None:
        if self._section.flight and self._keep_at is None and now_ns >= self._calm_ns:
            self._keep_at = now_ns + AFTERMATH_NS, code

    def _do(self, job: Callable[[], object]) -> None:
        self._queue.put(Item("job", 0, value=job))
        self._queue.wake()

    async def _done(self, job: Callable[[], T]) -> T:
        """What comes of a job of the thread."""
        answer: asyncio.Future[T] = self._loop.create_future()

        def carry_out() -> None:
            try:
                result = job()
            except Exception as error:  # noqa: BLE001 - whoever asked is told
                self._on_loop(partial(_fail, answer, error))
            else:
                self._on_loop(lambda: _tell(answer, result))

        self._do(carry_out)
        return await answer

    def _hear(self, told: Told) -> None:
        self._on_loop(lambda: self._heard(told))

    def _on_loop(self, act: Callable[[], object]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody listens
            self._loop.call_soon_threadsafe(act)

    def _heard(self, told: Told) -> None:
        if told.flight_failed is not None:
            self._failed = told.flight_failed
            self._due_ns = 0
            self._events.change(
                bool(told.flight_failed),
                "error",
                "recording.failed",
                f"the flight recorder cannot write: {told.flight_failed}"
                if told.flight_failed
                else "the flight recorder tries again",
                source="recording",
                remedy="make room on the disk; measuring goes on without it",
            )
        if told.kept is not None:
            text = f"the last minutes are kept in {told.kept}"
            self._events.report(
                "info", "recording.kept", text, source="recording", distinct=True
            )
        if told.stopped is not None:
            self._is_on = self._section.flight
            self._tell_stopped(*told.stopped, by_itself=True)

    def _tell_stopped(
        self, recorded: Recorded | None, why: str, *, by_itself: bool = False
    ) -> None:
        what = "the recording" if recorded is None else str(recorded.path)
        self._events.report(
            "error" if by_itself else "info",
            "recording.stopped",
            f"{what} has ended: {why}",
            source="recording",
            remedy="what is in it can be read; make room, then record again"
            if by_itself
            else "",
            distinct=True,
        )


def _is_fault(event: Event) -> bool:
    return (
        event.severity == "error"
        and event.active is not False
        and event.code.startswith(FAULTS)
    )


def _tell(answer: asyncio.Future[T], result: T) -> None:
    if not answer.done():
        answer.set_result(result)


def _fail(answer: asyncio.Future[T], error: Exception) -> None:
    if not answer.done():
        answer.set_exception(error)
