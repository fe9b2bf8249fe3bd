"""The measuring path: from deliveries of devices to points, scans and live poses.

Plain calls on the event loop; nothing waits. `Measurement` is used by the service,
replays and tests; `traverse.daemon.executor` has its commands.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.monitors import (
    DeviceStateTracker,
    LateReadingMonitor,
    TemperatureMonitor,
)
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import ARM
from traverse.daemon.conditions.utc import UtcCondition
from traverse.daemon.config.schema import Action, Configuration
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies, latencies_by_name
from traverse.daemon.points.capture import ActiveSession, Capture, PointWriter
from traverse.daemon.points.controller import PointController, PointFuture
from traverse.daemon.points.input_monitor import InputMonitor
from traverse.daemon.points.measurement import MeasurementContext
from traverse.daemon.pose.alignment import ActiveAlignment
from traverse.daemon.pose.arm_model import ArmModel, model_with_probe
from traverse.daemon.pose.condition_subjects import subjects_by_condition
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import ArmReadings, PoseBlock
from traverse.daemon.pose.probe_library import LibraryProbe
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.pose.quality_monitor import QualityMonitor
from traverse.daemon.pose.rest import RestDetector
from traverse.daemon.pose.trajectory import TrajectoryBuffer
from traverse.daemon.pose.uncertainty import (
    MOST_JITTER_NS,
    CovarianceEvaluator,
    CovarianceInput,
    SkewMonitor,
)
from traverse.daemon.readings.monitors import ReadingMonitors
from traverse.daemon.references.memory import ReferenceMemory
from traverse.daemon.references.monitor import ReferenceMonitor
from traverse.daemon.scans.between import samples_between
from traverse.daemon.scans.scanner import Scanner, ScanSink
from traverse.daemon.step_listener import StepListener
from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    CountSamples,
    Delivery,
    DeviceAlarm,
    DeviceClockState,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    RepeatedCount,
    StreamStarted,
)
from traverse.protocol.messages import (
    FLAG_MEANINGS,
    REMARKS,
    Live,
    QualityFlag,
)

MAX_TEMPERATURES = 1000  # in a snapshot


@dataclass(frozen=True, slots=True, eq=False)
class Sinks:
    """Consumers of results; the defaults ignore them.

    Attributes:
        write_point: writes a point to the disk; None if there is no room.
        offer_scan: takes a block of a scan; False if it is dropped. Calls its second
            argument if it is dropped later.
        on_action: called with button actions that do not concern points.
        status_changed: called when the content of the status message changes.
        latencies: by name, see `LATENCIES`.
        references: memory of confirmed devices.
    """

    events: EventLog
    write_point: PointWriter
    offer_scan: ScanSink = lambda scan, on_dropped: True
    offer_live: Callable[[Live], object] = lambda live: None
    on_action: Callable[[Action], object] = lambda action: None
    status_changed: Callable[[], None] = lambda: None
    latencies: Mapping[str, Latencies] = field(default_factory=latencies_by_name)
    references: ReferenceMemory = field(default_factory=ReferenceMemory)


class Measurement(MeasurementContext):
    """Turns deliveries into points, scan blocks, live poses and events.

    Begins a session unless one is given.

    Attributes:
        listener: notified before each step.
        devices: all configured ones, by id.
        joint_devices: those that read joints.
        latches: requests waiting for a latch, by its token.
        latch_points: unfinished requests of such points, by token.
        probe: probe of the library in use; None for the arm file's.
        probes: names in the library when last read; None without one.
        rate_hz: of the present sample stream.
    """

    def __init__(
        self,
        configuration: Configuration,
        model: ArmModel,
        sinks: Sinks,
        clock: HostClock,
        listener: StepListener | None = None,
        *,
        devices: Sequence[Device],
        session: ActiveSession | None = None,
    ) -> None:
        settings, capture = configuration.assembly, configuration.capture
        events = sinks.events
        self.configuration = configuration
        self.sinks = sinks
        self.clock = clock
        self.listener = listener or StepListener()
        self.devices = {device.section.id: device for device in devices}
        self.joint_devices = JointDevices(model, devices)
        self.pipeline = Pipeline(model, clock)
        self.resampler = Resampler(model, settings)
        parts = self.joint_devices, self.pipeline, self.resampler
        changed = sinks.status_changed
        self.conditions = ConditionMonitor(clock, events)
        self.utc = UtcCondition(clock, self.conditions)
        self.alignment = ActiveAlignment()
        self.capture = Capture(clock, sinks.write_point, self.alignment, session)
        published = PublishedNumbers(clock.to_utc_ns, self.capture.points_since)
        self.reading_monitors = ReadingMonitors(
            model, self.conditions, published, events
        )
        self._use_conditions()
        self.conditions.changed = changed
        self.states = DeviceStateTracker(
            clock, *parts, events, self.conditions, published, changed
        )
        self.late_readings = LateReadingMonitor(self.resampler, clock, events)
        self.temperatures = TemperatureMonitor(clock, self.conditions)
        self.skew = SkewMonitor(settings.skew_limit_mm)
        self.trajectory = TrajectoryBuffer()
        self._readings: list[ArmReadings] = []  # of which no pose is computed yet
        self.references = ReferenceMonitor(
            configuration.quality,
            model,
            clock,
            self.conditions,
            sinks.references,
            published,
            reset_turns=self.pipeline.reset_turns,
            use_offsets=self.pipeline.use_offsets,
        )
        self.quality = QualityMonitor(
            configuration.quality, model, clock, events, self.conditions
        )
        self.uncertainty = CovarianceEvaluator(
            configuration.uncertainty, self.reading_monitors.count_steps
        )
        self.point_wait_ns = int(settings.point_wait_s * 1e9)
        self.inputs = InputMonitor(capture, events)
        self._wake_at_presses()
        self.points = PointController(
            self,
            capture=self.capture,
            settings=capture,
            events=events,
            latencies=sinks.latencies,
            on_action=sinks.on_action,
        )
        self.scanner = Scanner(
            clock,
            sinks.offer_scan,
            capture.scan_block_s,
            configuration.scan,
            self.alignment,
        )
        self.live = LivePoseSampler(clock, capture.live_rate_hz, self.alignment)
        self.probe: LibraryProbe | None = None
        self.probes: tuple[str, ...] | None = None
        self.rate_hz = 0.0
        self.latches: dict[int, tuple[PointFuture, str | None]] = {}
        self.latch_points: dict[int, PointFuture] = {}
        # Points are made from the stream where nothing latches all joints for them.
        self._keeps_readings = self._has_triggers_elsewhere()
        self._rest = RestDetector()
        self._set_batch_window()

    @property
    def clock_device(self) -> Device:
        """Device whose sampling instants are those of the arm's samples."""
        clock = self.resampler.clock
        return next(d for d in self.joint_devices.devices if d.section.id == clock)

    @property
    def may_wait(self) -> bool:
        """Whether samples or points may ever wait for readings."""
        return self._keeps_readings or not self.joint_devices.is_single

    @property
    def is_idle(self) -> bool:
        return self.points.is_idle and not self.latches

    @property
    def model(self) -> ArmModel:
        return self.pipeline.model

    # -- settings -------------------------------------------------------------

    def apply_settings(self, configuration: Configuration, model: ArmModel) -> None:
        """Change arm file and configuration; only while `is_idle`."""
        self.configuration, capture = configuration, configuration.capture
        self.set_model(model)
        self.quality.use(configuration.quality, model)
        self.references.use(configuration.quality, model)
        self.uncertainty = CovarianceEvaluator(
            configuration.uncertainty, self.reading_monitors.count_steps
        )
        self.inputs.use(capture)
        self._wake_at_presses()
        self.points.use(capture)
        self._keeps_readings |= self._has_triggers_elsewhere()
        self.live.use_rate(capture.live_rate_hz)
        self.scanner.use_settings(capture.scan_block_s, configuration.scan)
        self._set_batch_window()

    def _use_conditions(self) -> None:
        model, section = self.model, self.configuration.quality
        identities = {name: it.identity for name, it in self.devices.items()}
        subjects = subjects_by_condition(model, section, identities)
        self.conditions.use(subjects, model.devices)
        if cause := model.geometry_doubt:
            self.conditions.doubt("geometry", cause=cause)
        else:
            self.conditions.establish("geometry")
        self.reading_monitors.establish()

    def set_model(self, model: ArmModel) -> None:
        self.evaluate_readings()
        self.reading_monitors.use_model(model)
        self.pipeline.use_model(model)
        self._use_conditions()
        self.quality.use_model(model)
        self.references.use(self.configuration.quality, model)
        self.trajectory.forget()  # it was that of another ball
        self.points.arm_changed()

    def set_probe(self, probe: LibraryProbe) -> None:
        """Measure with a probe of the library from the next sample on.

        Raises:
            ValueError: the arm cannot have it.
        """
        self.set_model(model_with_probe(self.model, probe))
        self.probe = probe

    def _wake_at_presses(self) -> None:
        for name, device in self.devices.items():
            device.delivery_queue.always_wakes = self.inputs.turns_round(name)

    def _has_triggers_elsewhere(self) -> bool:
        return not {d for d, _ in self.points.triggers} <= {*self.model.devices}

    def _set_batch_window(self) -> None:
        self.joint_devices.set_batch_window(
            self.configuration.capture, may_wait=self.may_wait, rests=self._rest.rests
        )

    # -- snapshots ------------------------------------------------------------

    @property
    def is_quiet(self) -> bool:
        """Whether a snapshot would be complete."""
        return self.is_idle and not self.scanner.is_running

    @property
    def probe_json(self) -> str | None:
        return None if self.probe is None else self.probe.model_dump_json()

    def snapshot(self) -> dict[str, object]:
        """Return the state that a recording begins with, as values and arrays."""
        air_mm, alignment = self.points.evaluator.tip.air_mm, self.alignment.alignment
        return {
            "idle": self.is_quiet,
            "model": self.model.digest,
            "probe": self.probe_json,
            "session": self.capture.session.id,
            "next_seq": self.capture.session.next_seq,
            "label": self.capture.label.model_dump(),
            "alignment": None if alignment is None else asdict(alignment),
            "air_mm": None if air_mm is None else air_mm.tolist(),
            "temperatures": self.quality.persistent.temperatures[-MAX_TEMPERATURES:],
            "pipeline": self.pipeline.state,
            **self.reading_monitors.state,
            "references": self.references.state,
            "conditions": self.conditions.state,
            "utc_doubt": [self.utc.doubt, self.utc.remedy],
        }

    # -- deliveries and time --------------------------------------------------

    def process_timeouts(self) -> None:
        """Process timeouts; call every 20 ms.

        Only here time is checked, so that deliveries that queued up are processed
        first.
        """
        now_ns = self.clock.step()
        self.listener.passed(now_ns, self)
        self._check_host_clock()
        self.evaluate_readings()
        self._take_assembled(now_ns)
        self.points.settle(now_ns)
        self.late_readings.check()

    def check_recent(self) -> None:
        """Doubt readings of devices that are there and send none; call it often.

        Inputs that are active for too long are reported.
        """
        now_ns = self.clock.running.monotonic_ns()
        plan = self.scanner.plan
        self.inputs.check(now_ns, is_scan_held=plan is not None and plan.held)
        for device in self.joint_devices.devices:
            if not device.is_recent(now_ns):
                text = f"{device.section.id} is there and sends no readings"
                self.conditions.mark("readings", ARM, text)

    def _check_host_clock(self) -> None:
        self.quality.check_clock()
        self.utc.check()

    def judge_utc(self, doubt: str, remedy: str) -> None:
        self.utc.doubt, self.utc.remedy = doubt, remedy
        self._check_host_clock()

    def dispatch(
        self, device: Device, delivery: Delivery, *, has_edges: bool = False
    ) -> None:
        """Process a delivery of a device.

        An edge needs the readings before it, but seldom their poses. Samples of a batch
        that ``has_edges`` are therefore evaluated as late, and in as large blocks, as
        if there were none.
        """
        device.last_ns = self.clock.step()
        self.listener.delivered(device.last_ns, delivery, self)
        self._check_host_clock()
        match delivery:
            case CountSamples():
                self._take_samples(device, delivery, has_edges)
                return
            case LatchedCounts():
                self._take_latch(device, delivery)
                return
        self.evaluate_readings()
        match delivery:
            case StreamStarted():
                self._take_stream(delivery)
            case DeviceTemperatures():
                self._take_temperatures(device, delivery)
            case DeviceCounters():
                device.counters.clear()
                device.counters.update(delivery.values)
            case DeviceUp():
                self.states.on_up(device, delivery)
                self.inputs.on_up(delivery, device.up_ns)
                self._use_conditions()
                self.quality.persistent.on_device_up(device.section.id)
                self.references.on_up(delivery)
                self.reading_monitors.on_up(delivery)
                if delivery.restarted:
                    self.trajectory.forget()
                # What cannot latch gives its points out of the stream.
                not_latching = not delivery.identity.latches
                self._keeps_readings |= not_latching and device in self.joint_devices
                self._set_batch_window()
            case DeviceLost():
                self.states.on_lost(device, delivery)
                self.inputs.on_lost(device.section.id)
            case DeviceAlarm():
                self.states.on_alarm(device, delivery)
                self.quality.persistent.alarm(
                    delivery.device, delivery.channel, delivery.code, delivery.raised
                )
            case DeviceClockState():
                self.states.on_clock(device, delivery)
            case DeviceFault():
                self.states.on_fault(device, delivery)
            case RepeatedCount():
                self.reading_monitors.take_repeat(delivery)

    def _take_temperatures(self, device: Device, delivery: DeviceTemperatures) -> None:
        device.take_temperatures(delivery)
        joint_devices = self.joint_devices
        if device in joint_devices and joint_devices.first_mismatched is None:
            self.temperatures.check(self.pipeline.model, joint_devices)

    def _take_samples(
        self, device: Device, samples: CountSamples, has_edges: bool
    ) -> None:
        device.samples += len(samples.seq)
        device.samples_ns = device.last_ns
        pressed = self.inputs.pressed_samples(samples)
        self.inputs.follow(pressed)
        self.points.follow_levels(pressed)
        if (
            device not in self.joint_devices
            or self.joint_devices.first_mismatched is not None
        ):
            return
        moduli_counts = () if device.identity is None else device.identity.moduli_counts
        repeats = self.reading_monitors.add_samples(samples, moduli_counts)
        self.references.add(samples, device.max_speed_rad_s, repeats)
        self._note_device_clock(samples)
        waited_ns = self.clock.running.monotonic_ns() - samples.received_ns
        self.sinks.latencies["queue_wait"].add(waited_ns)
        if self.joint_devices.is_single and samples.skew_ns is None:
            self._readings.append(self._read(samples))
            if self._keeps_readings:
                self.resampler.record(samples)
            first_ns = self._readings[0].samples.received_ns
            if (
                has_edges
                and samples.received_ns - first_ns
                < device.delivery_queue.wake_interval_ns
                and not self.scanner.is_running
                and not self.points.evaluator.needs_poses
            ):
                return
            self.evaluate_readings()
        else:
            self.resampler.add(samples, self.clock.monotonic_ns())
            self._take_assembled()
        self.points.settle()

    def _note_device_clock(self, samples: CountSamples) -> None:
        condition = "device_clock", samples.device
        if (samples.status & STATUS_TIME_UNCERTAIN).any():
            doubt = self.devices[samples.device].clock_doubt
            cause = doubt or FLAG_MEANINGS[QualityFlag.TIME_UNCERTAIN]
            self.conditions.mark(*condition, cause)
        else:
            self.conditions.settle(*condition, self.devices[samples.device].clock_text)

    def _take_assembled(self, now_ns: int | None = None) -> None:
        for samples, error_bounds_counts in self.resampler.resampled(now_ns):
            self._measure(self._read(samples), error_bounds_counts)

    def _read(self, samples: CountSamples) -> ArmReadings:
        readings = self.pipeline.read(samples)
        self.trajectory.follow(readings)
        self.reading_monitors.add_readings(readings, self.resampler.series_between)
        return readings

    def evaluate_readings(self) -> None:
        if self._readings:
            readings, self._readings = ArmReadings.joined(self._readings), []
            self._measure(readings, None)

    def _measure(
        self, readings: ArmReadings, error_bounds_counts: Floats | None
    ) -> None:
        """Pass readings of the whole arm down the pipeline."""
        model, temperature_c = self.pipeline.model, self.joint_devices.temperature_c
        samples = readings.samples
        # The place is that of an instant, which the device's clock leaves open.
        bound_ns = max(samples.time_bound_ns, self.resampler.time_bound_ns)
        poses = replace(
            self.pipeline.evaluate(readings, temperature_c), time_bound_ns=bound_ns
        )
        is_ok = not poses.quality[0] & ~np.uint32(REMARKS.value)
        if bound_ns and is_ok and self._begins(poses):
            poses.quality[0] |= np.uint32(QualityFlag.MOTION_UNKNOWN)
        if bound_ns >= MOST_JITTER_NS:
            poses.quality[:] |= np.uint32(QualityFlag.TIME_UNCERTAIN)
        if error_bounds_counts is not None:
            self.skew.flag_block(model, poses, error_bounds_counts)
        self.quality.flag_block(
            model, poses, temperature_c, is_scanning=self.scanner.is_running
        )
        taken_ns = self.clock.running.monotonic_ns() - samples.received_ns
        self.sinks.latencies["sample_to_pose"].add(taken_ns)
        self.trajectory.add(poses)
        is_needed = self.scanner.is_running or self.points.has_pending.is_set()
        if self._rest.follow(poses, is_needed=is_needed):
            self._set_batch_window()
        self.points.evaluator.follow(poses)
        needs_all = self.scanner.needs(poses)
        if needs_all and self.scanner.instants is not None:
            needs_all = False
            between = samples_between(self, poses, self.scanner.instants)
            if between is not None:
                self.scanner.take(model, *between)
        live = self.live.message(model, poses, self.capture.session.id, samples.device)
        if needs_all or live is not None:
            rows = slice(None) if needs_all else slice(-1, None)
            reading = self._covariance_input(
                readings, error_bounds_counts, bound_ns, rows
            )
            covariances_mm2 = self.uncertainty.covariances_mm2(model, reading)
            if needs_all:
                self.scanner.take(model, poses, covariances_mm2)
            if live is not None:
                self.sinks.offer_live(_with_covariance(live, covariances_mm2[-1]))
        self.temperatures.check(model, self.joint_devices)

    def _begins(self, poses: PoseBlock) -> bool:
        """Return whether nothing before a block says how fast the arm moves."""
        time_ns, angles_rad = int(poses.sample_time_ns[0]), poses.angles_rad[0]
        return self.trajectory.speeds_rad_s(time_ns, angles_rad) is None

    def _covariance_input(
        self,
        readings: ArmReadings,
        error_bounds_counts: Floats | None,
        time_bound_ns: int,
        rows: slice,
    ) -> CovarianceInput:
        """Return what covariances of some of the latest readings rest on."""
        temperature_c = self.joint_devices.temperature_c
        return CovarianceInput(
            self.pipeline.block_of(readings, temperature_c).part(rows),
            self.trajectory.block_speeds_rad_s(readings)[rows],
            None if error_bounds_counts is None else error_bounds_counts[rows],
            time_bound_ns,
        )

    def _take_latch(self, device: Device, latch: LatchedCounts) -> None:
        if latch.input is not None:
            name, number = device.section.id, latch.input
            latch = self.inputs.pressed_latch(latch)
            if self.points.triggers.get((name, number)) == "button":
                self._hold_scan(name, number, latch)
            counts = self.inputs.take_edge(latch, device.debounce_key)
            self.points.take_edge(device, latch, counts=counts)
        elif (waiting := self.latches.pop(latch.token, None)) is not None:
            self.points.add_latched(device, latch, *waiting)

    def _hold_scan(self, device: str, number: int, latch: LatchedCounts) -> None:
        key = device, number
        late_s = self.scanner.edge(key, latch.sample_time_ns, latch.active)
        if late_s:
            self.sinks.events.report(
                "warning",
                "scan.edge_late",
                f"an edge of a button arrived {late_s:.3f} s too late: the held scan "
                f"{'begins' if latch.active else 'ends'} so much late here",
                source=f"{device}/{number}",
                remedy="raise held_wait_s of [scan], or lower the debounce time",
                data={"late_s": late_s},
            )

    def _take_stream(self, started: StreamStarted) -> None:
        model = self.pipeline.model
        rate_hz = started.rate_hz
        device = self.devices[started.device]
        device.period_ns = round(1e9 / rate_hz) if rate_hz > 0 else 0
        if started.reached_hz and device.identity is not None:
            reached_hz = started.reached_hz
            device.identity = replace(device.identity, max_rate_hz=reached_hz)
        if started.device in model.devices:
            self.resampler.set_rate(started.device, started.rate_hz)
        if started.device == self.resampler.clock:
            self.rate_hz = started.rate_hz
            self._rest.rests = False  # perhaps a scan begins
            self._set_batch_window()
            self.scanner.follow(started.stream, started.rate_hz, started.requested_hz)


def _with_covariance(live: Live, covariance_mm2: Floats) -> Live:
    """Add the covariance of a live pose, unless it is unknown."""
    if np.isnan(covariance_mm2).any():
        return live
    return live.model_copy(update={"covariance_mm2": tuple(covariance_mm2.tolist())})
