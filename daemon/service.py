"""The daemon composed: driver -> pipeline -> MQTT, from start to orderly end."""

import asyncio
import contextlib
import logging
import signal
from pathlib import Path

from traverse.daemon.acquisition.device import Device, open_device, running_drivers
from traverse.daemon.clock import HostClock
from traverse.daemon.command_table import CommandTable
from traverse.daemon.commands.button_actions import ButtonScans
from traverse.daemon.commands.dispatcher import CommandDispatcher
from traverse.daemon.commands.reload import Inputs
from traverse.daemon.config.schema import Action, BrokerSection, Configuration
from traverse.daemon.executor import stop_scan
from traverse.daemon.frozen_clock import FrozenClock
from traverse.daemon.health import HealthReport
from traverse.daemon.inputs import StartupError
from traverse.daemon.measurement import Sinks, build_measurement
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.mqtt.credentials import address_of
from traverse.daemon.output import Output
from traverse.daemon.pose.arm_model import ArmModel, log_model
from traverse.daemon.reports import Reports
from traverse.daemon.startup_check import StartupCheck
from traverse.daemon.state_dir import state_path
from traverse.daemon.system.lifecycle import ServiceLifecycle
from traverse.daemon.system.systemd import Notifier
from traverse.protocol import topics

log = logging.getLogger(__name__)

DRAIN_S = 2.0
FLUSH_S = 0.25
TIMEOUT_PERIOD_S = 0.02
LOOP_PASSES = 4  # in which deliveries that already wait are processed


class Service:
    """One arm, its devices and its broker."""

    def __init__(
        self,
        configuration: Configuration,
        broker: BrokerSection,
        model: ArmModel,
        path: Path,
        *,
        embedded: bool,
        keep_trying: bool,
    ) -> None:
        self._configuration = configuration
        self._clock = HostClock()
        self._stopping = asyncio.Event()
        self._hang_up = asyncio.Event()
        notifier, health = Notifier(), HealthReport(self._clock)
        steps = FrozenClock(self._clock)
        self._output = Output(
            configuration,
            path,
            arm=model.name,
            encoding=broker.encoding,
            clock=self._clock,
            steps=steps,
            health=health,
            session=lambda: self._measurement.capture.session.id,
            status_changed=self._publish_status,
        )
        self._button_scans = ButtonScans(self._output.events)
        loop = asyncio.get_running_loop()
        self._devices = [open_device(d, loop) for d in configuration.device]
        output = self._output
        sinks = Sinks(
            output.events,
            output.recorder.following(output.outbox.put),
            output.spool.offer,
            lambda live: output.outlet.publish("live", live),
            self._on_action,
            self._publish_status,
            health.latencies,
        )
        self._measurement = build_measurement(
            configuration, model, sinks, steps, output.recorder, devices=self._devices
        )
        output.spool.taken_back = self._measurement.scanner.take_back
        output.recorder.measurement = self._measurement
        self._table = CommandTable(
            Inputs(configuration, model),
            path,
            embedded=embedded,
            measurement=self._measurement,
            output=self._output,
            notifier=notifier,
            use=self._use,
        )
        self._commands = CommandDispatcher(
            arm=model.name,
            encoding=broker.encoding,
            events=self._output.events,
            clock=self._clock,
            response_topics=broker.response_topics,
            offer=lambda answer: self._output.queue.offer("reply", answer),
            carry_out=self._table.carry_out,
        )
        self._reports = Reports(
            arm=model.name,
            encoding=broker.encoding,
            clock=self._clock,
            measurement=self._measurement,
            output=self._output,
            commands=self._commands,
            health=health,
        )
        offline = self._reports.status(online=False)
        self._publisher = BrokerConnection(
            address=address_of(broker, path.parent),
            client_id=f"traverse-{model.name}",
            will=self._output.outlet.outgoing("status", offline),
            encoding=broker.encoding,
            queue=self._output.queue,
            subscription=topics.command_filter(model.name),
            receive=self._commands.receive,
            changed=self._broker_changed,
        )
        self._reports.publisher = self._publisher
        self._arrival = StartupCheck(
            self._devices,
            self._publisher,
            self._output.events,
            keep_trying=keep_trying,
        )
        self._life = ServiceLifecycle(
            configuration=configuration,
            folder=state_path(path),
            notifier=notifier,
            clock=self._clock,
            devices=self._devices,
            events=self._output.events,
            health=health,
            publisher=self._publisher,
            figures=lambda: self._reports.health(anew=False),
            waiting=lambda: self._output.outbox.health().unsent,
            heartbeats=lambda: self._output.heartbeats,
        )
        self._output.told = self._life.look_at

    async def run(self) -> None:
        """Start, measure until stopped, end in order.

        Raises:
            StartupError: a device or the broker could not be reached.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stopping.set)
        loop.add_signal_handler(signal.SIGHUP, self._hang_up.set)
        failure: StartupError | None = None
        async with (
            running_drivers(self._devices),
            self._output.running(),
            self._life,
            asyncio.TaskGroup() as tasks,
        ):
            running = [tasks.create_task(self._consume(d)) for d in self._devices]
            try:
                self._life.begin(self._arrival.longest_s)
                await self._arrival.wait(self._stopping)
                if not self._stopping.is_set():
                    running.append(tasks.create_task(self._publisher.run()))
                    running.append(tasks.create_task(self._poll_periodically()))
                    running.append(tasks.create_task(self._process_timeouts()))
                    running.append(
                        tasks.create_task(
                            self._button_scans.run(self._table.change_scan)
                        )
                    )
                    running.append(tasks.create_task(self._reload_at_signals()))
                    self._publish_status()
                    self._table.track()
                    settings = self._configuration.capture
                    log_model(self._measurement.model, settings.compensation)
                    await self._arrival.broker(self._stopping)
                    self._life.ready()
                    await self._stopping.wait()
                    self._life.stop(DRAIN_S)
                    await self._drain()
            except StartupError as error:
                failure = error  # raised outside the group, which would wrap it
            finally:
                await self._commands.close()
                for task in running:
                    task.cancel()
        if failure is not None:
            raise failure

    def _use(self, inputs: Inputs) -> None:
        """Go by a new configuration and arm file."""
        configuration = self._configuration = inputs.configuration
        self._measurement.apply_settings(configuration, inputs.model)
        self._table.use(inputs)
        self._output.use(configuration)
        self._publisher.renew()
        self._publish_status()
        log_model(inputs.model, configuration.capture.compensation)

    async def _reload_at_signals(self) -> None:
        while True:
            await self._hang_up.wait()
            self._hang_up.clear()
            await self._table.reload.on_sighup()

    async def _drain(self) -> None:
        stop_scan(self._measurement)
        self._output.events.flush(at_once=True)
        self._output.outlet.publish("status", self._reports.status(online=False))
        log.info("stopping")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(DRAIN_S):
                await self._output.idle()

    async def _consume(self, device: Device) -> None:
        while True:
            deliveries = await device.delivery_queue.take()
            with self._output.queue.together():
                for delivery in deliveries:
                    begun_ns = self._clock.monotonic_ns()
                    self._measurement.dispatch(device, delivery)
                    self._life.note(device, delivery, begun_ns)

    async def _process_timeouts(self) -> None:
        """Process what waits for readings, or for time to pass; else sleep."""
        while True:
            if not self._measurement.may_wait:
                await self._measurement.points.has_pending.wait()
            await asyncio.sleep(TIMEOUT_PERIOD_S)
            for _ in range(LOOP_PASSES):
                await asyncio.sleep(0)
            self._measurement.process_timeouts()

    def _on_action(self, action: Action) -> None:
        """Execute what a button means besides points."""
        if action == "session":
            self._publish_status()
        else:
            self._button_scans.request("start" if action == "scan" else "stop")

    async def _poll_periodically(self) -> None:
        due_s = 0.0
        loop = asyncio.get_running_loop()
        while True:
            period_s = self._configuration.health.period_s
            self._output.poll()
            self._life.tell()
            self._commands.check_flood_end()
            if loop.time() >= due_s:
                due_s = loop.time() + period_s
                self._publish_health()
            await asyncio.sleep(min(FLUSH_S, period_s))

    # -- messages -------------------------------------------------------------

    def _publish_status(self) -> None:
        self._output.outlet.publish("status", self._reports.status())

    def _publish_health(self) -> None:
        self._output.outlet.publish("health", self._reports.health(anew=True))

    def _broker_changed(self, connected: bool, text: str) -> None:
        self._arrival.broker_state_known.set()
        if connected:
            self._publish_status()
        self._output.events.change(
            not connected,
            "error",
            "broker.lost",
            text,
            source="broker",
            remedy="" if connected else "start or correct the broker; points are kept",
        )
