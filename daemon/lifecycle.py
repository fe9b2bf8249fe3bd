"""Run a composed service: start, measure until a signal, end in order."""

import asyncio
import contextlib
import logging
import signal
from collections.abc import AsyncIterator, Coroutine
from typing import Any

from traverse.broker.certificates import CertificateWatch
from traverse.daemon.acquisition.device import Device, running_drivers
from traverse.daemon.commands.dispatcher import MAX_REMEMBERED
from traverse.daemon.commands.expiry import PERIOD_S
from traverse.daemon.commands.points import point_result
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.executor import stop_scan
from traverse.daemon.inputs import StartupError
from traverse.daemon.measurement import Measurement
from traverse.daemon.monitoring.latencies import timed_collections
from traverse.daemon.monitoring.metrics_endpoint import metrics_endpoint
from traverse.daemon.mqtt.connection import run_until_first
from traverse.daemon.pose.arm_model import log_model
from traverse.daemon.service import Service
from traverse.daemon.startup_check import check_startup, startup_limit_s
from traverse.daemon.system.memory import trim_memory_periodically
from traverse.daemon.system.realtime import freeze_objects, prepare
from traverse.daemon.system.systemd import Watchdog
from traverse.drivers.base.driver import CLOSE_S
from traverse.drivers.base.values import LatchedCounts

log = logging.getLogger("traverse.daemon.service")

DRAIN_S = 2.0
FLUSH_S = 0.25
SPARE_S = 5.0
TIMEOUT_PERIOD_S = 0.02
LOOP_PASSES = 4  # in which deliveries that already wait are processed


async def run(service: Service, *, keep_trying: bool) -> None:
    """Start, measure until SIGTERM or SIGINT, end in order.

    With ``keep_trying`` it starts without unreachable devices or broker.

    Raises:
        StartupError: a device or the broker could not be reached.
        DatabaseRefusedError: a database must be left alone.
    """
    loop = asyncio.get_running_loop()
    stopping, hang_up = asyncio.Event(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    loop.add_signal_handler(signal.SIGHUP, hang_up.set)
    events, devices = service.events, service.devices
    configuration, notifier = service.measurement.configuration, service.notifier
    watchdog = Watchdog(notifier, devices, lambda: service.heartbeats, events)
    failure: StartupError | None = None
    with timed_collections(service.latencies["collection"]):
        async with (
            running_drivers(devices),
            service.outbox.running(),
            service.spool.running(),
            service.recorder.running(),
            metrics_endpoint(configuration.metrics, service.metrics, events),
            _in_background(watchdog.run(), trim_memory_periodically()),
            asyncio.TaskGroup() as tasks,
        ):
            service.utc.check()
            running = [tasks.create_task(consume(service, d)) for d in devices]
            try:
                service.update_status_line()
                notifier.starting(startup_limit_s(devices) + SPARE_S)
                freeze_objects()  # while the devices answer
                check = check_startup(
                    devices, service.connection, events, keep_trying=keep_trying
                )
                await run_until_first(check, stopping.wait())
                if not stopping.is_set():
                    await _remember_answers(service)
                    works = (
                        service.connection.run(service.receive),
                        _poll_periodically(service),
                        process_timeouts(service.measurement),
                        service.button_scans.run(service.scans.change_scan),
                        _reload_at_signals(service, hang_up),
                    )
                    running += [tasks.create_task(work) for work in works]
                    async with _in_background(_publish_changes(service)):
                        await _measure(service, stopping)
                    await _drain(service)
            except StartupError as error:
                failure = error  # raised outside the group, which would wrap it
            finally:
                await service.commands.close()
                service.utc.close()
                service.doubts.close()
                for task in running:
                    task.cancel()
    if failure is not None:
        raise failure


async def _remember_answers(service: Service) -> None:
    """Load answers of an earlier run, so that no request takes a second point."""
    with contextlib.suppress(RequestRefusedError):  # the outbox reports its own trouble
        for request, point in await service.outbox.answered(MAX_REMEMBERED):
            name = "point" if point.retracts is None else "undo"
            service.commands.remember(name, request, point_result(point))


@contextlib.asynccontextmanager
async def _in_background(*works: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    tasks = [asyncio.create_task(work) for work in works]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _measure(service: Service, stopping: asyncio.Event) -> None:
    measurement = service.measurement
    configuration = measurement.configuration
    service.publish_status()
    service.scans.request_tracking_rate()
    log_model(measurement.model, configuration.capture.compensation)
    known = service.connection.state_known.wait()
    await run_until_first(known, stopping.wait())
    readers = [device.driver.thread for device in service.devices]
    prepare(configuration.realtime, readers, service.events)
    service.phase = "measuring"
    service.update_status_line()
    service.notifier.ready()
    await stopping.wait()


async def _drain(service: Service) -> None:
    """End scans and send waiting messages, for a limited time."""
    service.phase = "stopping"
    service.notifier.stopping(DRAIN_S + CLOSE_S + SPARE_S)
    service.update_status_line()
    stop_scan(service.measurement)
    service.events.flush(at_once=True)
    service.publish_status()
    log.info("stopping")
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(DRAIN_S):
            await service.outbox.idle()
            await service.spool.idle()
            await service.queue.empty()


async def consume(service: Service, device: Device) -> None:
    """Process a device's deliveries in the call that wakes the loop."""
    clock, measurement = service.clock, service.measurement
    handling = service.latencies["handling"]
    failed = asyncio.get_running_loop().create_future()

    def take_waiting() -> None:
        try:
            deliveries = device.delivery_queue.take_waiting()
            has_edges = any(isinstance(d, LatchedCounts) for d in deliveries)
            for delivery in deliveries:
                begun_ns = clock.monotonic_ns()
                measurement.dispatch(device, delivery, has_edges=has_edges)
                handling.add(clock.monotonic_ns() - begun_ns)
        except Exception as error:  # noqa: BLE001 - raised where it is awaited
            if not failed.done():
                failed.set_exception(error)

    with device.delivery_queue.notifying(take_waiting):
        await failed


async def process_timeouts(measurement: Measurement) -> None:
    """Process timeouts while something waits; else sleep."""
    while True:
        if not measurement.may_wait:
            await measurement.points.has_pending.wait()
        await asyncio.sleep(TIMEOUT_PERIOD_S)
        for _ in range(LOOP_PASSES):
            await asyncio.sleep(0)
        measurement.process_timeouts()


async def _poll_periodically(service: Service) -> None:
    """Continue deferred work a few times a second, and publish health."""
    due_s = clock_due_s = 0.0
    certificates = CertificateWatch(
        # Not as a lasting event: points are good while the connection lasts.
        lambda warning: service.events.report(
            "warning",
            "broker.certificate",
            warning.text,
            remedy=warning.remedy,
            distinct=True,
        )
    )
    loop = asyncio.get_running_loop()
    while True:
        period_s = service.measurement.configuration.health.period_s
        service.measurement.check_recent()
        service.measurement.conditions.check_overdue()
        service.events.flush()
        service.queue.flush()
        service.utc.check()
        service.outbox.poll()
        service.spool.poll()
        service.recorder.poll()
        service.update_status_line()
        service.commands.check_flood_end()
        if service.phase != "stopping":  # the last status is not to be replaced
            service.others.poll()
        certificates.check(service.connection.certificate_ends)
        if loop.time() >= clock_due_s:
            clock_due_s = loop.time() + PERIOD_S
            service.publish_clock()
        if loop.time() >= due_s:
            due_s = loop.time() + period_s
            service.publisher.publish("health", service.health_message(anew=True))
        await asyncio.sleep(min(FLUSH_S, period_s))


async def _publish_changes(service: Service) -> None:
    while True:
        await service.status_due.wait()
        service.status_due.clear()
        service.publish_status()


async def _reload_at_signals(service: Service, hang_up: asyncio.Event) -> None:
    while True:
        await hang_up.wait()
        hang_up.clear()
        await service.reloader.on_sighup()
