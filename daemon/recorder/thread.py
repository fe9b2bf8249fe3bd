"""The thread that writes recordings; its faults never stop measuring."""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TypeVar

from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.recorder.file import (
    ManualRecording,
    PreTriggerBuffer,
    Recorded,
    entries_of,
)
from traverse.daemon.recorder.flight import FlightRecorder, reason_of
from traverse.daemon.recorder.item_queue import RecorderItem, RecorderQueue
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.protocol.messages import Scan
from traverse.recording.run_writer import Entry, RunHead

log = logging.getLogger("traverse.daemon.recorder")

TURN_S = 30.0  # that a slow disk may take
# A reader with a press waits until this thread releases the interpreter.
MAX_SLICE_S, YIELD_S = 0.0005, 0.0001

T = TypeVar("T")


@dataclass(eq=False)
class RecorderThread:
    """Takes items from the queue and writes them to the open recordings.

    Args:
        files: arm file, configuration and so on at the start.
        utc_offset_ns: UTC minus host monotonic time at the start.
        on_flight_failure, on_kept: as of the flight recorder; called on the loop.
        on_stopped: called on the loop when a recording ended by itself, with its
            figures and the reason.

    Attributes:
        flight: the flight recorder, for its figures.
    """

    queue: RecorderQueue
    _: KW_ONLY
    folder: Path
    section: RecordingSection
    about: Mapping[str, str]
    files: Mapping[str, bytes]
    utc_offset_ns: int
    on_flight_failure: Callable[[str], None]
    on_kept: Callable[[Path], None]
    on_stopped: Callable[[Recorded | None, str], None]

    def __post_init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._ring = PreTriggerBuffer()
        self.flight = FlightRecorder(
            self.folder,
            self.section,
            self.about,
            on_failure=lambda reason: self._notify(self.on_flight_failure, reason),
            on_kept=lambda path: self._notify(self.on_kept, path),
        )
        self._manual: ManualRecording | None = None
        self._flushed_s = 0.0
        self._ended = False
        self.heartbeat = Heartbeat("thread of recordings")
        self._thread = threading.Thread(target=self._run, name="recorder")

    @property
    def recorded(self) -> Recorded | None:
        manual = self._manual
        try:
            return None if manual is None else manual.recorded
        except OSError:
            return None

    def start(self) -> None:
        self._thread.start()

    def join(self) -> None:
        if self._thread.ident is not None:
            self._thread.join()

    def submit(self, job: Callable[[], object]) -> None:
        """Call a job in the thread, after everything queued."""
        self.queue.put(RecorderItem("job", 0, value=job))
        self.queue.wake()

    async def call(self, job: Callable[[], T]) -> T:
        """Call a job in the thread; return its result or raise its exception."""
        result: Future[T] = Future()

        def execute() -> None:
            if not result.set_running_or_notify_cancel():
                return
            try:
                result.set_result(job())
            except Exception as error:  # noqa: BLE001 - raised in the caller
                result.set_exception(error)

        self.submit(execute)
        return await asyncio.wrap_future(result)

    # -- jobs of the thread ----------------------------------------------------

    def begin(self, name: str, note: str) -> Path:
        """Begin a recording; return its path.

        Raises:
            OSError: it cannot be written.
        """
        path = self.folder / f"{name}.mcap"
        about = {**self.about, "name": name, "note": note, "cause": "asked"}
        head = RunHead(about, self.files)
        self._manual = ManualRecording(path, name, self.section, head, self._ring)
        return path

    def finish(self) -> Recorded:
        """End the recording; return its figures.

        Raises:
            OSError: there is none, or its end cannot be written.
        """
        if self._manual is None:
            raise FileNotFoundError("nothing is being recorded")
        manual, self._manual = self._manual, None
        try:
            return manual.close()
        except OSError:
            manual.writer.abandon()
            raise

    def end(self) -> None:
        self._ended = True

    # -- the thread -----------------------------------------------------------

    def _run(self) -> None:
        try:
            self.flight.use(FlightRecorder.recover_crashed)
            while not self._ended:
                self.heartbeat.beat(TURN_S)
                due_s = self._flushed_s + self.section.flush_s
                items = self.queue.take(due_s - time.monotonic())
                begun_s = time.monotonic()
                for item in items:
                    self._take(item)
                    if time.monotonic() - begun_s > MAX_SLICE_S:
                        time.sleep(YIELD_S)
                        begun_s = time.monotonic()
                now_s = time.monotonic()
                if now_s >= due_s:
                    self._flushed_s = now_s
                    self.flight.retry(now_s)
                    self.flight.use(FlightRecorder.flush)
                    self._in_manual(ManualRecording.flush)
            self._close()
        except Exception as error:
            log.exception("fault in the recorder")
            self.flight.abandon()
            self._notify(self.on_flight_failure, f"fault in the recorder: {error!r}")
            if self._manual is not None:
                self._stop_manual(error)
            self._refuse_rest()
        finally:
            self.heartbeat.idle()

    def _execute(self, item: RecorderItem) -> bool:
        """Execute a requested item; False if it is to be recorded."""
        if item.kind == "job":
            item.value()
        elif item.kind == "keep":
            self.flight.use(lambda flight: flight.keep(item.name))
        else:
            return False
        return True

    def _take(self, item: RecorderItem) -> None:
        if self._execute(item):
            return
        if item.kind == "state":
            self._ring.begin_segment(item.at_ns)
            utc_ns = item.at_ns + self.utc_offset_ns
            self.flight.use(
                lambda flight: flight.begin_segment(item.at_ns, utc_ns, self.files)
            )
        elif isinstance(item.value, Scan) and self._manual is None:
            return  # as a cloud it is for recordings with a name only
        elif item.kind == "gap":
            self._ring.clear()
            if self._manual is not None:
                self._manual.gaps += 1
        elif item.kind == "files":
            self._take_files(item.value["files"])
            item = RecorderItem(
                "files", item.at_ns, value={"probe": item.value["probe"]}
            )
        elif item.kind == "related":
            self.utc_offset_ns = item.value
        for entry in entries_of(item, self.utc_offset_ns):
            self._record(entry)

    def _take_files(self, files: Mapping[str, bytes]) -> None:
        self.files = files
        self._ring.clear()  # what is in it was made with other files
        self.flight.use(lambda flight: flight.attach(files))
        self._in_manual(lambda manual: manual.writer.attach(files))
        self.flight.end_segment()

    def _record(self, entry: Entry) -> None:
        self._ring.add(entry)
        self.flight.use(lambda flight: flight.add(entry))
        self._in_manual(lambda manual: manual.writer.add(entry))

    def _in_manual(self, act: Callable[[ManualRecording], object]) -> None:
        if self._manual is None:
            return
        try:
            act(self._manual)
        except OSError as error:
            self._stop_manual(error)

    def _stop_manual(self, error: Exception) -> None:
        manual, recorded = self._manual, self.recorded
        self._manual = None
        if manual is not None:
            manual.writer.abandon()
        self._notify(self.on_stopped, recorded, reason_of(error))

    def _close(self) -> None:
        self.flight.use(FlightRecorder.close)
        if self._manual is not None:
            recorded, why = None, "the daemon ends"
            try:
                recorded = self.finish()
            except OSError as error:
                why = reason_of(error)
            self._notify(self.on_stopped, recorded, why)

    def _refuse_rest(self) -> None:
        """Fail all waiting requests after a fault."""
        while not self._ended:
            for item in self.queue.take():
                self._execute(item)

    def _notify(self, callback: Callable[..., None], *args: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(callback, *args)
