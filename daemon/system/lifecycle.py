"""The daemon's life as the system sees it: ready, alive, measured, ended.

Composes what `traverse run` needs as a service and what the measuring itself knows
nothing of: the service manager, the watchdog, the claims of `[realtime]`, the ring of
cycles and the metrics endpoint.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Self

from traverse.daemon.acquisition.device import Device
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import Configuration
from traverse.daemon.health import HealthReport
from traverse.daemon.monitoring.events import EventLog, Occurrence
from traverse.daemon.monitoring.loop_cycles import (
    CycleLog,
    CycleReports,
    GarbageCollectionTimer,
)
from traverse.daemon.monitoring.metrics_endpoint import metrics_endpoint
from traverse.daemon.monitoring.prometheus import exposition
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.system.memory import trim_memory_periodically
from traverse.daemon.system.realtime import prepare
from traverse.daemon.system.systemd import Notifier, StatusLine, Watchdog
from traverse.drivers.base.driver import CLOSE_S
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Health

SPARE_S = 5.0


class ServiceLifecycle:
    """Use as an asynchronous context manager around the measuring.

    Args:
        configuration: of the daemon.
        folder: where reports of cycles go.
        notifier: the way to the service manager.
        clock: the host's.
        devices: all of the configuration.
        events: receives faults.
        health: collects latencies.
        publisher: whose connection is reported.
        figures: the current health, without a reset.
        waiting: points that the broker does not have yet.
        heartbeats: signs of life of all threads but the readers.
    """

    def __init__(
        self,
        *,
        configuration: Configuration,
        folder: Path,
        notifier: Notifier,
        clock: HostClock,
        devices: list[Device],
        events: EventLog,
        health: HealthReport,
        publisher: BrokerConnection,
        figures: Callable[[], Health],
        waiting: Callable[[], int],
        heartbeats: Callable[[], Iterable[Heartbeat]],
    ) -> None:
        self._configuration = configuration
        self._devices = devices
        self._events = events
        self._health = health
        self._publisher = publisher
        self._figures = figures
        self._waiting = waiting
        self._notifier = notifier
        self._watchdog = Watchdog(notifier, devices, heartbeats, events)
        self._collections = GarbageCollectionTimer(health.latencies["collection"])
        handling = health.latencies["handling"]
        self._cycles = CycleLog(clock, self._collections, handling)
        self._reports = CycleReports(self._cycles, folder, clock)
        self._status_line = StatusLine()
        self._phase, self._sent_line = "starting", ""
        self._stack = contextlib.AsyncExitStack()

    async def __aenter__(self) -> Self:
        self._stack.enter_context(self._collections)
        await self._stack.enter_async_context(
            metrics_endpoint(self._configuration.metrics, self._metrics, self._events)
        )
        for work in (self._watchdog.run(), trim_memory_periodically()):
            self._stack.push_async_callback(_cancel, asyncio.create_task(work))
        self.tell()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._reports.close()
        await self._stack.aclose()
        await self._reports.finish("end" if error is None else f"end: {error!r}")

    def begin(self, limit_s: float) -> None:
        """Start-up may take so long."""
        self._notifier.starting(limit_s + SPARE_S)

    def ready(self) -> None:
        """Everything is there, or its absence has been reported."""
        readers = [device.driver.thread for device in self._devices]
        prepare(self._configuration.realtime, readers, self._events)
        self._phase = "measuring"
        self.tell()
        self._notifier.ready()

    def stop(self, limit_s: float) -> None:
        """The end begins; what waits is sent for so long."""
        self._phase = "stopping"
        self._notifier.stopping(limit_s + CLOSE_S + SPARE_S)
        self.tell()

    def tell(self) -> None:
        """Send the line of status, if it has changed; call it a few times a second."""
        line = self._status_line.text(
            self._phase,
            {device.section.id: device.state for device in self._devices},
            self._publisher.state,
            self._waiting(),
        )
        if line != self._sent_line:
            self._sent_line = line
            self._notifier.status(line)

    def note(self, device: Device, delivery: Delivery, begun_ns: int) -> None:
        """A delivery has been handled."""
        queue = device.delivery_queue.waiting_samples
        self._cycles.record(device.section.id, delivery, begun_ns, queue)

    def look_at(self, what: Occurrence) -> None:
        """Write the cycles down if this event is a fault."""
        self._reports.on_event(what)

    def _metrics(self) -> str:
        return exposition(
            self._figures(),
            self._health.latencies,
            time.process_time(),
            version("traverse-cmm"),
        )


async def _cancel(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
