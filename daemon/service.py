"""The daemon composed: drivers, pipeline and MQTT, from start to orderly end.

`Service` builds all parts, and `run` runs them until the daemon is to end.
"""

import asyncio
import contextlib
import logging
import signal
import time
from collections.abc import AsyncIterator, Coroutine
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from traverse.daemon.acquisition.device import Device, open_device, running_drivers
from traverse.daemon.clock import FrozenClock, HostClock
from traverse.daemon.command_handlers import handlers_of
from traverse.daemon.commands.dispatcher import MAX_REMEMBERED, CommandDispatcher
from traverse.daemon.commands.expiry import KEPT_S, PERIOD_S, CommandExpiry
from traverse.daemon.commands.points import PointCommands, point_result
from traverse.daemon.commands.rate_limit import OURS, PAUSE_S, TokenBucket
from traverse.daemon.commands.reload import ConfigurationReloader
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.commands.scans import ButtonScans, ScanCommands
from traverse.daemon.config.schema import Action, BrokerSection, Configuration
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.executor import JudgeUtc, stop_scan
from traverse.daemon.inputs import REFUSED, Inputs, StartupError, address_of
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import latencies_by_name, timed_collections
from traverse.daemon.monitoring.metrics_endpoint import metrics_endpoint
from traverse.daemon.monitoring.prometheus import exposition
from traverse.daemon.mqtt.connection import BrokerConnection, run_until_first
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.mqtt.second_daemon import SecondDaemonWatch
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.daemon.points.capture import ActiveSession
from traverse.daemon.pose.arm_model import log_model
from traverse.daemon.pose.reference_file import ReferenceFile
from traverse.daemon.recorder.recorded_inputs import recorded_files
from traverse.daemon.recorder.recorder import Recorder, StepRecorder
from traverse.daemon.reports import (
    HealthReporter,
    health_counters,
    status_message,
)
from traverse.daemon.startup_check import check_startup, startup_limit_s
from traverse.daemon.state_dir import (
    OUTBOX,
    PROBE,
    RECORDINGS,
    REFERENCES,
    SCANS,
    UTC,
    state_path,
)
from traverse.daemon.store.outbox import Outbox
from traverse.daemon.store.scan_store import ScanStore
from traverse.daemon.system.memory import trim_memory_periodically
from traverse.daemon.system.realtime import freeze_objects, prepare
from traverse.daemon.system.systemd import Notifier, StatusLine, Watchdog
from traverse.daemon.utc_watch import UtcWatch
from traverse.drivers.base.driver import CLOSE_S
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import LatchedCounts
from traverse.kinematics.model.kernel_choice import KERNEL
from traverse.protocol import topics
from traverse.protocol.messages import Health, Status

log = logging.getLogger(__name__)

DRAIN_S = 2.0
FLUSH_S = 0.25
SPARE_S = 5.0
TIMEOUT_PERIOD_S = 0.02
LOOP_PASSES = 4  # in which deliveries that already wait are processed


class Service:
    """All parts of one arm's daemon; needs a running event loop.

    Attributes:
        latencies: by name, see `LATENCIES`.
        status_due: set when the published status is out of date.
        phase: activity, for the service manager.

    Raises:
        StartupError: a file has gone since it was read.
    """

    phase = "starting"

    def __init__(
        self, inputs: Inputs, broker: BrokerSection, path: Path, *, embedded: bool
    ) -> None:
        configuration, model, _, signer, _ = inputs
        arm, encoding = model.name, broker.encoding
        self.clock = clock = HostClock()
        self.notifier = notifier = Notifier()
        self.latencies = latencies = latencies_by_name()
        self.status_due = status_due = asyncio.Event()
        self.health = HealthReporter(clock, latencies)
        self.status_line = StatusLine()

        try:
            files = recorded_files(path, configuration)
        except OSError as error:
            raise StartupError([f"{error}; was it moved just now?"], REFUSED) from error
        steps = StepRecorder(clock, flight=configuration.recording.flight)
        step_clock = FrozenClock(clock, steps.related)
        active = ActiveSession(step_clock)
        self.queue = queue = OutgoingQueue()
        self.publisher = publisher = MessagePublisher(
            arm, encoding, queue, clock, steps
        )
        self.events = events = EventLog(
            clock,
            lambda what: publisher.publish_event(what, active.session.id),
            arm,
            status_due.set,  # whoever connects later learns from it what lasts
        )
        self.recorder = recorder = Recorder(
            configuration.recording,
            steps,
            folder=(state_path(path) / RECORDINGS).absolute(),
            clock=step_clock,
            about={"arm": arm, "version": version("traverse-cmm"), "kernel": KERNEL},
            files=files,
            events=events,
        )
        self.outbox = outbox = Outbox(
            state_path(path) / OUTBOX,
            publisher,
            events,
            section=configuration.outbox,
            limit=configuration.capture.max_waiting_points,
            latencies=latencies,
            ready_changed=status_due.set,
            signer=signer,
        )
        self.spool = spool = ScanStore(
            state_path(path) / SCANS, publisher, events, configuration.scan
        )

        self.button_scans = ButtonScans(events)

        self.devices = [
            open_device(section, asyncio.get_running_loop())
            for section in configuration.device
        ]
        sinks = Sinks(
            events,
            steps.following(outbox.put_point),
            spool.offer,
            lambda live: publisher.publish("live", live),
            self._on_action,
            status_due.set,
            latencies,
            ReferenceFile(state_path(path) / REFERENCES),
        )
        self.measurement = measurement = Measurement(
            configuration,
            model,
            sinks,
            step_clock,
            steps,
            devices=self.devices,
            session=active,
        )
        _take_probes(measurement, inputs)

        self.expiry = CommandExpiry(arm, clock)
        self.others = SecondDaemonWatch(arm, encoding, clock, events, status_due.set)
        self._limits_of_ours = {
            topic: TokenBucket(OURS, clock)
            for topic in (topics.status_topic(arm), topics.clock_topic(arm))
        }

        self.connection = connection = BrokerConnection(
            address=address_of(broker, path.parent),
            client_id=f"traverse-{arm}",
            will=publisher.outgoing("status", self.status(False)),
            encoding=encoding,
            queue=queue,
            subscriptions=(
                topics.command_filter(arm),
                topics.status_topic(arm),
                topics.clock_topic(arm),
            ),
            changed=self._broker_changed,
            limit_exceeded=self._limit_exceeded,
            least_retry_s=lambda: self.others.retry_s,
        )

        self.scans = scans = ScanCommands(measurement)

        def apply_inputs(inputs: Inputs) -> None:
            configuration, model, *_ = inputs
            measurement.apply_settings(configuration, model)
            scans.request_tracking_rate()
            outbox.use(configuration.outbox)
            spool.use(configuration.scan)
            try:
                files = recorded_files(path, configuration)
            except OSError as error:  # it was there a moment ago, when it was read
                log.warning("recordings will lack the new files: %s", error)
                files = {}
            steps.reloaded(step_clock.step(), files, measurement.probe_json)
            connection.renew()
            self.publish_status()
            log_model(model, configuration.capture.compensation)

        self.reloader = reloader = ConfigurationReloader(
            path=path,
            embedded=embedded,
            inputs=inputs,
            measurement=measurement,
            use=apply_inputs,
            events=events,
            notifier=notifier,
        )
        self.utc = UtcWatch(clock, state_path(path) / UTC, self._judge_utc)
        points = PointCommands(
            measurement,
            _probe_library(path, configuration),
            self.utc.confirm,
            self.utc.confirm_unverified,
            state_path(path) / PROBE,
        )
        self.commands = CommandDispatcher(
            arm=arm,
            encoding=encoding,
            events=events,
            clock=clock,
            expiry=self.expiry,
            response_topics=broker.response_topics,
            offer=lambda answer: queue.offer("reply", answer),
            carry_out=handlers_of(
                points, scans, reloader, ResendCommands(outbox, spool), recorder
            ),
        )

    @property
    def heartbeats(self) -> tuple[Heartbeat, ...]:
        stores = (*self.outbox.heartbeats, *self.spool.heartbeats)
        return (*stores, self.recorder.heartbeat)

    def receive(self, incoming: IncomingCommand) -> float:
        """Take a command, or a status or clock of this arm; see `CommandDispatcher`."""
        limit = self._limits_of_ours.get(incoming.topic)
        if limit is None:
            return self.commands.receive(incoming)
        if not limit.take():
            self.events.report(
                "warning",
                "broker.flood",
                f"another program writes to {incoming.topic}, which is for this daemon "
                "alone, faster than it is read",
                remedy="find it; see the broker's access list",
            )
            return PAUSE_S
        if incoming.topic == self.expiry.topic:
            self.expiry.receive(incoming)
        else:
            self.others.receive(incoming.payload, retained=incoming.retained)
        return 0.0

    def status(self, online: bool) -> Status:
        """Return the status, or that of a daemon that has ended."""
        signer = self.outbox.signer
        message = status_message(
            self.measurement,
            self.clock,
            self.publisher.encoding,
            keeps_points=self.outbox.is_ready,
            active=self.events.active,
            public_key=None if signer is None else signer.public_key,
            online=online,
        )
        return self.others.sending(message)

    def _judge_utc(self, doubt: str, remedy: str) -> None:
        JudgeUtc(doubt, remedy).execute(self.measurement)
        self.outbox.trust_clock(not doubt)
        self.spool.trust_clock(not doubt)

    def _on_action(self, action: Action) -> None:
        if action == "session":
            self.status_due.set()
        else:
            self.button_scans.request("start" if action == "scan" else "stop")

    def _broker_changed(self, connected: bool, text: str) -> None:
        self.others.connected(connected)
        if connected:
            self.publish_clock()  # before the status: who waits for it may send then
            self.publish_status()
        remedy = "" if connected else "start or correct the broker; points are kept"
        self.events.change(not connected, "error", "broker.lost", text, remedy=remedy)

    def _limit_exceeded(self, kind: str, text: str) -> None:
        remedy = "raise the broker's limit (mosquitto: max_packet_size)"
        self.events.change(
            bool(text),
            "error",
            "broker.packet_limit",
            text or f"no message ({kind}) was too long for the broker yet",
            source=kind,
            remedy=remedy if text else "",
        )

    def publish_status(self) -> None:
        self.publisher.publish("status", self.status(True))

    def publish_clock(self) -> None:
        """Publish the clock by which commands expire; it is not recorded."""
        message = self.publisher.outgoing("clock", self.expiry.message())
        self.queue.offer("clock", replace(message, expiry_s=KEPT_S))

    def health_message(self, *, anew: bool) -> Health:
        """Return the figures; ``anew`` begins another period."""
        queue, connection = self.queue, self.connection
        return self.health.message(
            self.measurement,
            broker=connection.health(),
            outbox=self.outbox.health(),
            spool=self.spool.health(),
            recording=self.recorder.health(),
            counters=health_counters(
                self.measurement, self.spool, self.commands, connection, queue
            ),
            anew=anew,
        )

    def metrics(self) -> str:
        health = self.health_message(anew=False)
        cpu_s = time.process_time()
        conditions = {
            (standing.name, standing.subject): standing.established
            for standing in self.measurement.conditions.standings
        }
        about = version("traverse-cmm")
        return exposition(health, self.latencies, cpu_s, about, conditions)

    def update_status_line(self) -> None:
        states = {device.section.id: device.state for device in self.devices}
        unsent = self.outbox.health().unsent
        line = self.status_line.text(self.phase, states, self.connection.state, unsent)
        in_doubt = dict.fromkeys(
            standing.name
            for standing in self.measurement.conditions.standings
            if not standing.established
        )
        if in_doubt and self.phase == "measuring":
            line += f", in doubt: {', '.join(in_doubt)}"
        self.notifier.status(line)


def _take_probes(measurement: Measurement, inputs: Inputs) -> None:
    """Take the library's names, and the probe that was in use before a restart."""
    measurement.probes = inputs.probes
    if inputs.probe is not None:
        measurement.set_probe(inputs.probe)
        log.info("probe %s is in use, as before the restart", inputs.probe.name)


def _probe_library(path: Path, configuration: Configuration) -> Path | None:
    library = configuration.arm.probes
    return None if library is None else path.parent / library


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
            running = [tasks.create_task(_consume(service, d)) for d in devices]
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
                        _process_timeouts(service.measurement),
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
    """Begin to measure, and wait until the daemon is to end."""
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
    service.publisher.publish("status", service.status(False))
    log.info("stopping")
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(DRAIN_S):
            await service.outbox.idle()
            await service.spool.idle()
            await service.queue.empty()


async def _consume(service: Service, device: Device) -> None:
    """Process a device's deliveries in the call that wakes the loop."""
    clock, measurement = service.clock, service.measurement
    handling = service.latencies["handling"]
    failed = asyncio.get_running_loop().create_future()

    def take_waiting() -> None:
        try:
            taken = device.delivery_queue.take_waiting()
            has_edges = any(isinstance(d, LatchedCounts) for d in taken)
            for delivery in taken:
                begun_ns = clock.monotonic_ns()
                measurement.dispatch(device, delivery, has_edges=has_edges)
                handling.add(clock.monotonic_ns() - begun_ns)
        except Exception as error:  # noqa: BLE001 - raised where it is awaited
            if not failed.done():
                failed.set_exception(error)

    with device.delivery_queue.notifying(take_waiting):
        await failed


async def _process_timeouts(measurement: Measurement) -> None:
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
        service.others.poll()
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
