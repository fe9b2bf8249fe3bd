"""The daemon composed: drivers, pipeline, stores and MQTT.

`traverse.daemon.lifecycle` runs it.
"""

import asyncio
import logging
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from traverse.daemon.acquisition.device import open_device
from traverse.daemon.clock import FrozenClock, HostClock
from traverse.daemon.command_handlers import handlers_of
from traverse.daemon.commands.dispatcher import CommandDispatcher
from traverse.daemon.commands.expiry import KEPT_S, CommandExpiry
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.rate_limit import OURS, PAUSE_S, TokenBucket
from traverse.daemon.commands.reload import ConfigurationReloader
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.commands.scans import ButtonScans, ScanCommands
from traverse.daemon.config.schema import Action, BrokerSection, Configuration
from traverse.daemon.executor import JudgeUtc
from traverse.daemon.inputs import REFUSED, Inputs, StartupError, address_of
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.doubt_file import DoubtFile
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import latencies_by_name
from traverse.daemon.monitoring.prometheus import exposition
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.mqtt.second_daemon import SecondDaemonWatch
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.daemon.points.capture import ActiveSession
from traverse.daemon.pose.arm_model import log_model
from traverse.daemon.recorder.recorded_inputs import recorded_files
from traverse.daemon.recorder.recorder import Recorder, StepRecorder
from traverse.daemon.references.memory_file import ReferenceFile
from traverse.daemon.reports import (
    HealthReporter,
    health_counters,
    status_message,
)
from traverse.daemon.state_dir import (
    DOUBTS,
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
from traverse.daemon.system.systemd import Notifier, StatusLine
from traverse.daemon.utc_watch import UtcWatch
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.kinematics.model.kernel_choice import KERNEL
from traverse.protocol import topics
from traverse.protocol.messages import Health, Status

log = logging.getLogger(__name__)


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

        files = _files_of(path, configuration)
        steps = StepRecorder(clock, flight=configuration.recording.flight)
        step_clock = FrozenClock(clock, steps.related)
        active = ActiveSession(step_clock)
        self.queue = queue = OutgoingQueue()
        self.publisher = publisher = MessagePublisher(
            arm, encoding, queue, clock, steps
        )
        self.doubts = DoubtFile(state_path(path) / DOUBTS)
        self.events = events = EventLog(
            clock,
            lambda event: publisher.publish_event(event, active.session.id),
            arm,
            status_due.set,  # whoever connects later learns from it what lasts
            self.doubts.add,
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
            configuration, model = inputs.configuration, inputs.model
            _use_inputs(measurement, inputs)
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
                points,
                scans,
                reloader,
                ResendCommands(outbox, spool, self.doubts.latest),
                recorder,
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
        signer = self.outbox.signer
        message = status_message(
            self.measurement,
            self.clock,
            self.publisher.encoding,
            keeps_points=self.outbox.is_ready,
            active=self.events.active,
            doubts=self.doubts.latest,
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
        """Publish the status: offline at the end, also if the broker is back then."""
        self.publisher.publish("status", self.status(self.phase != "stopping"))

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


def _files_of(path: Path, configuration: Configuration) -> dict[str, bytes]:
    try:
        return recorded_files(path, configuration)
    except OSError as error:
        raise StartupError([f"{error}; was it moved just now?"], REFUSED) from error


def _take_probes(measurement: Measurement, inputs: Inputs) -> None:
    """Take the library's names, and the probe that was in use before a restart."""
    measurement.probes = inputs.probes
    if inputs.probe is not None:
        measurement.set_probe(inputs.probe)
        log.info("probe %s is in use, as before the restart", inputs.probe.name)


def _use_inputs(measurement: Measurement, inputs: Inputs) -> None:
    """Measure with inputs that were read again; the model has the probe."""
    measurement.apply_settings(inputs.configuration, inputs.model)
    measurement.probes, measurement.probe = inputs.probes, inputs.probe


def _probe_library(path: Path, configuration: Configuration) -> Path | None:
    library = configuration.arm.probes
    return None if library is None else path.parent / library
