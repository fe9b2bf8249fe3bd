"""The measuring part of the daemon in a world: built anew at each start.

Drivers, queues, clocks, the measuring path, its commands and its memory are the
daemon's own, composed as `traverse.daemon.service` does. MQTT, the outbox and
recordings are left out: a point is on the disk when it is written.
"""

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ParamSpec, TypeVar

from benchmarks.honesty.arm import LIBRARY
from benchmarks.honesty.cable import HostEnd, open_host_end
from benchmarks.honesty.hub import Hub, Reader
from traverse.daemon.acquisition.device import Device
from traverse.daemon.clock import FrozenClock, HostClock
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.scans import ScanCommands
from traverse.daemon.config.schema import Configuration
from traverse.daemon.executor import JudgeUtc
from traverse.daemon.inputs import _probe_in_use
from traverse.daemon.lifecycle import consume, process_timeouts
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog, Occurrence
from traverse.daemon.pose.arm_model import read_model
from traverse.daemon.pose.probe_library import read_probe_in_use, read_probes
from traverse.daemon.references.jumps import JumpMonitor
from traverse.daemon.references.memory_file import ReferenceFile
from traverse.daemon.startup_check import check_devices
from traverse.daemon.state_dir import PROBE
from traverse.daemon.store.records import PendingPoint
from traverse.daemon.utc_watch import UtcWatch
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.registry import driver_class
from traverse.drivers.io.ports import BytePort, PortAccess
from traverse.drivers.polling.polled_driver import PolledDriver
from traverse.protocol.messages import Live, Point, Scan

FLUSH_S = 0.25


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class AtOnce(Executor):
    """Executes work at once: writing takes no virtual time."""

    def __init__(self, *names: object) -> None:
        del names

    def submit(  # type: ignore[override]  # as much as is used
        self, work: Callable[..., Any], /, *arguments: object
    ) -> "Future[Any]":
        done: Future[Any] = Future()
        done.set_result(work(*arguments))
        return done


async def to_thread_at_once(
    work: Callable[Arguments, Result],
    /,
    *arguments: Arguments.args,
    **named: Arguments.kwargs,
) -> Result:
    """Stand in for `asyncio.to_thread`; reading and writing take no virtual time."""
    return work(*arguments, **named)


class WorldClock(HostClock):
    """The host's two clocks."""

    def __init__(self, hub: Hub, utc_s: Callable[[], float]) -> None:
        self._hub, self._utc_s = hub, utc_s

    def monotonic_ns(self) -> int:
        return self._hub.monotonic_ns()

    def elapsed_ns(self) -> int:
        """Return true time since the start of the world, suspended or not."""
        return round(1e9 * self._hub.now_s)

    def utc_offset_ns(self) -> int:
        """Return the host's assumed offset to UTC."""
        return round(1e9 * self._utc_s()) - self._hub.monotonic_ns()


class DaemonRun:
    """One run of the daemon, from its start to its end.

    Args:
        take_point, take_scan, take_live: Called with each published message.
        is_synchronised: Whether the kernel says that a program keeps UTC.
    """

    def __init__(
        self,
        hub: Hub,
        clock: HostClock,
        configuration: Configuration,
        folder: Path,
        *,
        take_point: Callable[["DaemonRun", Point], object],
        take_scan: Callable[["DaemonRun", Scan], object],
        take_live: Callable[["DaemonRun", Live], object],
        take_event: Callable[[Occurrence], None],
        is_synchronised: Callable[[], bool],
    ) -> None:
        self._hub, self._configuration = hub, configuration
        step_clock = FrozenClock(clock)
        self.events = EventLog(clock, take_event)
        self._memory = ReferenceFile(folder / "references.json")

        def write(point: Point, begun_ns: int, note: str) -> PendingPoint:
            pending = PendingPoint(point)
            pending.settle()
            take_point(self, point)
            return pending

        def offer(scan: Scan, on_dropped: Callable[[], object]) -> bool:
            take_scan(self, scan)
            return True

        loop = asyncio.get_running_loop()
        ids = {section.id: section for section in configuration.device}
        self._readers: list[Reader] = []
        self._devices = [self._open(section, loop) for section in configuration.device]
        self.measurement = Measurement(
            configuration,
            read_model(folder / configuration.arm.file, ids),
            Sinks(
                self.events,
                write,
                offer,
                lambda live: take_live(self, live),
                references=self._memory,
            ),
            step_clock,
            devices=self._devices,
        )
        self._take_probe(folder)
        self.points = PointCommands(
            self.measurement,
            folder / LIBRARY,
            probe_in_use=folder / PROBE,
        )
        self.scans = ScanCommands(self.measurement)
        self._service = SimpleNamespace(
            clock=clock,
            measurement=self.measurement,
            latencies=self.measurement.sinks.latencies,
            queue=SimpleNamespace(together=contextlib.nullcontext),
            outbox=SimpleNamespace(together=contextlib.nullcontext),
        )
        self._tasks: list[asyncio.Task[Any]] = []
        self._utc = UtcWatch(clock, folder / "utc.json", self._judge_utc)
        self._utc._judge._synchronised = is_synchronised

    def _take_probe(self, folder: Path) -> None:
        """Measure with the probe that was chosen before; needs the library then."""
        if read_probe_in_use(folder / PROBE) is None:
            return
        library, model = read_probes(folder / LIBRARY), self.measurement.model
        probe = _probe_in_use(folder / PROBE, library, model)
        if probe is not None:
            self.measurement.set_probe(probe)

    def _judge_utc(self, doubt: str, remedy: str) -> None:
        JudgeUtc(doubt, remedy).execute(self.measurement)

    def _open(self, section: Any, loop: asyncio.AbstractEventLoop) -> Device:  # noqa: ANN401 - of any driver
        hub = self._hub
        queue = DeliveryQueue(loop, monotonic_ns=hub.monotonic_ns)
        kind = driver_class(section.driver)
        services: dict[str, Any] = {}
        if issubclass(kind, PolledDriver):

            def open_port(
                path: str, baud_rate: int, wake_fd: int, **line: object
            ) -> HostEnd:
                return open_host_end(hub, path, baud_rate)

            def wait_for_any(
                ports: Sequence[BytePort], wake_fd: int, seconds: float
            ) -> list[int]:
                ends: Any = ports
                hub.wait(seconds, lambda: any(end.ready for end in ends))
                return [index for index, end in enumerate(ends) if end.ready]

            services["ports"] = PortAccess(open_port, wait_for_any)
        driver = kind(
            section.id,
            section.options,
            queue,
            monotonic_ns=hub.monotonic_ns,
            **services,
        )
        return Device(section, queue, driver)

    async def start(self) -> None:
        """Begin as the service does: devices answer, the stream is requested."""
        self._utc.check()
        self._readers = [self._hub.start(d.driver) for d in self._devices]
        self._tasks = [
            # The measuring half of a service, which has all that this uses.
            asyncio.create_task(consume(self._service, d))  # type: ignore[arg-type]
            for d in self._devices
        ]
        await check_devices(self._devices)
        for device in self._devices:
            if device.state == "starting":
                device.state = "lost"
        self._tasks.append(asyncio.create_task(process_timeouts(self.measurement)))
        self._tasks.append(asyncio.create_task(self._flush()))
        self.scans.request_tracking_rate()

    async def _flush(self) -> None:
        while True:
            self._utc.check()
            self.measurement.check_recent()
            self.measurement.conditions.check_overdue()
            self.events.flush()
            await asyncio.sleep(FLUSH_S)

    def jump_monitors(self) -> dict[str, JumpMonitor]:
        monitors = self.measurement.references._monitors
        return {device: of_device[1] for device, of_device in monitors.items()}

    def check(self) -> None:
        for task in self._tasks:
            if task.done():
                task.result()

    async def end(self) -> None:
        for reader in self._readers:
            self._hub.kill(reader)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._memory.close()
        self._utc.close()
