"""The daemon composed: driver -> pipeline -> MQTT, from start to orderly end."""

import asyncio
import contextlib
import logging
import signal
from pathlib import Path

from daemon.align_requests import AlignRequests
from daemon.alignment import PartSystem
from daemon.arm_devices import ArmDevices
from daemon.arrival import Arrival
from daemon.broker_access import address_of
from daemon.broker_section import BrokerSection
from daemon.button_actions import ButtonActions
from daemon.capture import Capture, triggers_of
from daemon.clock import HostClock
from daemon.commands import CommandDesk
from daemon.configuration import Configuration
from daemon.device import Device, open_device, running_drivers
from daemon.events import EventLog, Occurrence
from daemon.health import HealthReport
from daemon.life import Life
from daemon.live import LiveView
from daemon.measuring import Measuring
from daemon.model import ArmModel
from daemon.model_told import tell_model
from daemon.notify import Notifier
from daemon.outbox import Outbox
from daemon.outgoing import OutgoingQueue
from daemon.outlet import Outlet
from daemon.pipeline import Pipeline
from daemon.point_requests import PointRequests
from daemon.probe_requests import ProbeRequests
from daemon.publisher import Publisher
from daemon.record_requests import RecordRequests, recorder_of, tell_reloaded
from daemon.recorder_state import MeasuringState
from daemon.reload import Inputs, Reload
from daemon.reports import Reports
from daemon.requests import Requests
from daemon.resend_requests import ResendRequests
from daemon.scan_spool import ScanSpool
from daemon.scanner import Scanner
from daemon.startup import StartupError
from daemon.state_folder import OUTBOX, SCANS, state_path
from daemon.step_clock import StepClock
from daemon.uncertainty import Uncertainty
from protocol import topics
from protocol.encoding import Encoding

log = logging.getLogger(__name__)

DRAIN_S = 2.0
FLUSH_S = 0.25
TIME_S = 0.02
TURNS = 4  # of the loop, in which deliveries that wait already are taken


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
        folder = path.parent
        self._path = path
        self._configuration = configuration
        self._encoding: Encoding = broker.encoding
        self._arm = model.name
        self._clock = HostClock()
        self._stopping = asyncio.Event()
        self._hang_up = asyncio.Event()
        settings = configuration.capture
        self._queue = OutgoingQueue()
        self._outlet = Outlet(self._arm, self._encoding, self._queue, self._clock)
        self._events = EventLog(self._clock, self._tell_event, self._arm)
        self._notifier = Notifier()
        self._health = HealthReport(self._clock)
        self._part = PartSystem()
        self._steps = StepClock(self._clock)
        self._recorder = recorder_of(
            configuration,
            path,
            arm=self._arm,
            clock=self._steps,
            events=self._events,
        )
        self._outlet.tape = self._recorder
        self._outbox = Outbox(
            state_path(path) / OUTBOX,
            arm=self._arm,
            encoding=self._encoding,
            clock=self._clock,
            section=configuration.outbox,
            limit=settings.max_waiting_points,
            session=lambda: self._capture.session.id,
            queue=self._queue,
            events=self._events,
            latencies=self._health.latencies,
            changed=self._publish_status,
        )
        self._capture = Capture(
            self._steps, self._recorder.following(self._outbox.keep), self._part
        )
        self._spool = ScanSpool(
            state_path(path) / SCANS,
            arm=self._arm,
            encoding=self._encoding,
            clock=self._clock,
            section=configuration.scan,
            outlet=self._outlet,
            queue=self._queue,
            events=self._events,
        )
        self._scanner = Scanner(
            self._steps,
            self._spool.offer,
            settings.scan_block_s,
            configuration.scan,
            self._part,
        )
        self._spool.taken_back = self._scanner.take_back
        self._live = LiveView(self._steps, settings.live_rate_hz, self._part)
        loop = asyncio.get_running_loop()
        self._devices = [open_device(d, loop) for d in configuration.device]
        self._arm_devices = ArmDevices(model, self._devices)
        self._measuring = Measuring(
            clock=self._steps,
            devices=self._arm_devices,
            settings=configuration.assembly,
            uncertainty=Uncertainty(configuration.uncertainty),
            pipeline=Pipeline(model, self._steps),
            capture=self._capture,
            triggers=triggers_of(settings),
            scanner=self._scanner,
            live=self._live,
            events=self._events,
            health=self._health,
            offer_live=lambda live: self._outlet.publish("live", live),
            status_changed=self._publish_status,
            taking=settings,
            quality=configuration.quality,
            tape=self._recorder,
        )
        self._recorder.state = MeasuringState(self._measuring, self._capture)
        self._reports = Reports(
            arm=self._arm,
            encoding=self._encoding,
            clock=self._clock,
            devices=self._devices,
            arm_devices=self._arm_devices,
            measuring=self._measuring,
            capture=self._capture,
            scanner=self._scanner,
            live=self._live,
            outbox=self._outbox,
            spool=self._spool,
            recorder=self._recorder,
            queue=self._queue,
            health=self._health,
        )
        self._requests = Requests(
            settings=settings,
            scan=configuration.scan,
            devices=self._arm_devices,
            scanner=self._scanner,
            measuring=self._measuring,
        )
        self._point_requests = PointRequests(
            settings=settings,
            devices=self._arm_devices,
            capture=self._capture,
            measuring=self._measuring,
            session_changed=self._publish_status,
        )
        probes = configuration.arm.probes
        self._probe_requests = ProbeRequests(
            library=None if probes is None else folder / probes,
            measuring=self._measuring,
            changed=self._publish_status,
        )
        self._reload = Reload(
            path=path,
            embedded=embedded,
            inputs=Inputs(configuration, model),
            devices=self._devices,
            measuring=self._measuring,
            with_probe=self._probe_requests.model_of,
            use=self._use,
            events=self._events,
            notifier=self._notifier,
        )
        align = AlignRequests(self._part, self._measuring)
        actions = ButtonActions(self._requests.change_scan, self._events)
        self._measuring.points.carry_out |= {
            "scan": actions.start_scan,
            "stop": actions.stop_scan,
            "session": self._publish_status,
        }
        self._commands = CommandDesk(
            arm=model.name,
            encoding=self._encoding,
            events=self._events,
            clock=self._clock,
            response_topics=broker.response_topics,
            offer=lambda answer: self._queue.offer("reply", answer),
            carry_out={
                "point": self._point_requests.take_point,
                "undo": self._point_requests.undo,
                "label": self._point_requests.label,
                "session": self._point_requests.begin_session,
                "probe": self._probe_requests.change,
                "scan": self._requests.change_scan,
                "align": align.change,
                "reload": self._reload.carry_out,
                "resend": ResendRequests(
                    self._outbox.resend, self._spool.again
                ).carry_out,
                "record": RecordRequests(self._recorder).carry_out,
            },
        )
        self._publisher = Publisher(
            address=address_of(broker, folder),
            client_id=f"traverse-{model.name}",
            will=self._outlet.outgoing("status", self._reports.status(online=False)),
            encoding=self._encoding,
            queue=self._queue,
            subscription=topics.command_filter(model.name),
            receive=self._commands.receive,
            changed=self._broker_changed,
        )
        self._reports.commands = self._commands
        self._reports.publisher = self._publisher
        self._arrival = Arrival(
            self._devices, self._publisher, self._events, keep_trying=keep_trying
        )
        self._life = Life(
            configuration=configuration,
            folder=state_path(path),
            notifier=self._notifier,
            clock=self._clock,
            devices=self._devices,
            events=self._events,
            health=self._health,
            publisher=self._publisher,
            figures=lambda: self._reports.health(anew=False),
            waiting=lambda: self._outbox.health().unsent,
            pulses=lambda: (
                self._outbox.pulse,
                self._recorder.pulse,
                *self._spool.pulses,
            ),
        )

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
            self._outbox.running(),
            self._spool.running(),
            self._recorder,
            self._life,
            asyncio.TaskGroup() as tasks,
        ):
            running = [tasks.create_task(self._consume(d)) for d in self._devices]
            try:
                self._life.begin(self._arrival.longest_s)
                await self._arrival.wait(self._stopping)
                if not self._stopping.is_set():
                    running.append(tasks.create_task(self._publisher.run()))
                    running.append(tasks.create_task(self._keep_house()))
                    running.append(tasks.create_task(self._keep_time()))
                    running.append(tasks.create_task(self._reload_at_signals()))
                    self._publish_status()
                    self._requests.track()
                    settings = self._configuration.capture
                    tell_model(self._measuring.model, settings.compensation)
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
        self._measuring.use(configuration, inputs.model)
        self._requests.use(configuration.capture, configuration.scan)
        self._point_requests.use(configuration.capture)
        self._outbox.use(configuration.outbox)
        self._spool.use(configuration.scan)
        tell_reloaded(self._recorder, self._path, configuration)
        self._publisher.renew()
        self._publish_status()
        tell_model(inputs.model, configuration.capture.compensation)

    async def _reload_at_signals(self) -> None:
        while True:
            await self._hang_up.wait()
            self._hang_up.clear()
            await self._reload.on_signal()

    async def _drain(self) -> None:
        self._measuring.stop_scan()
        self._events.flush(at_once=True)
        self._outlet.publish("status", self._reports.status(online=False))
        log.info("stopping")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(DRAIN_S):
                await self._outbox.idle()
                await self._spool.idle()
                await self._queue.empty()

    async def _consume(self, device: Device) -> None:
        while True:
            for delivery in await device.crossing.take():
                begun_ns = self._clock.monotonic_ns()
                self._measuring.take(device, delivery)
                self._life.note(device, delivery, begun_ns)

    async def _keep_time(self) -> None:
        """See to what waits for readings, or for time to pass; else sleep."""
        while True:
            if not self._measuring.may_wait:
                await self._measuring.points.some_wait.wait()
            await asyncio.sleep(TIME_S)
            for _ in range(TURNS):
                await asyncio.sleep(0)
            self._measuring.keep_time()

    async def _keep_house(self) -> None:
        due_s = 0.0
        loop = asyncio.get_running_loop()
        while True:
            period_s = self._configuration.health.period_s
            self._events.flush()
            self._life.tell()
            self._commands.see_calm()
            self._outbox.keep_house()
            self._spool.keep_house()
            self._recorder.keep_house()
            if loop.time() >= due_s:
                due_s = loop.time() + period_s
                self._publish_health()
            await asyncio.sleep(min(FLUSH_S, period_s))

    # -- messages -------------------------------------------------------------

    def _publish_status(self) -> None:
        self._outlet.publish("status", self._reports.status())

    def _tell_event(self, what: Occurrence) -> None:
        self._outlet.publish_event(what, self._capture.session.id)
        self._life.look_at(what)

    def _publish_health(self) -> None:
        self._outlet.publish("health", self._reports.health(anew=True))

    def _broker_changed(self, connected: bool, text: str) -> None:
        self._arrival.broker_told.set()
        if connected:
            self._publish_status()
        self._events.change(
            not connected,
            "error",
            "broker.lost",
            text,
            source="broker",
            remedy="" if connected else "start or correct the broker; points are kept",
        )
