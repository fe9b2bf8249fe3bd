"""What the daemon does with everything that a device delivers.

Runs on the event loop, in plain calls; nothing here waits.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.monitors import (
    DeviceStateTracker,
    LateReadingMonitor,
    TemperatureMonitor,
)
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import (
    AssemblySection,
    CaptureSection,
    Configuration,
    QualitySection,
)
from traverse.daemon.health import HealthReport
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import Capture, TriggerMap, triggers_of
from traverse.daemon.points.controller import PointController, PointFuture
from traverse.daemon.points.measurement import MeasurementContext
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.pose.quality_monitor import QualityMonitor
from traverse.daemon.pose.trajectory import TrajectoryBuffer
from traverse.daemon.pose.uncertainty import (
    CovarianceEvaluator,
    CovarianceInput,
    SkewMonitor,
)
from traverse.daemon.scans.scanner import ScanController, Scanner
from traverse.daemon.step_listener import StepListener
from traverse.drivers.base.values import (
    CountSamples,
    Delivery,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.protocol.messages import Live


class Measuring:
    """Turns deliveries into points, scan blocks, live poses and events.

    Args:
        clock: the host's.
        devices: that read the arm's joints.
        settings: how readings of different instants are brought together.
        uncertainty: states the covariance of points.
        offer_live: hands a live pose to the outgoing queue.
        status_changed: called when a device's state has changed.
        taking: how points are taken; by default at each press.
        quality: limits beyond which measurements are marked.
        tape: told of each step, before it is taken.

    Attributes:
        points: takes points at edges and on request.
        scans: takes scans.
        latches: who waits for a latch on request, by its token.
        rate_hz: of the samples of the arm that come now.
    """

    def __init__(
        self,
        *,
        clock: HostClock,
        devices: JointDevices,
        settings: AssemblySection,
        uncertainty: CovarianceEvaluator,
        pipeline: Pipeline,
        capture: Capture,
        triggers: TriggerMap,
        scanner: Scanner,
        live: LivePoseSampler,
        events: EventLog,
        health: HealthReport,
        offer_live: Callable[[Live], object],
        status_changed: Callable[[], None],
        taking: CaptureSection | None = None,
        quality: QualitySection | None = None,
        tape: StepListener | None = None,
    ) -> None:
        self._clock = clock
        self._tape = tape or StepListener()
        self._devices = devices
        self._pipeline = pipeline
        self._capture = capture
        self._triggers = triggers
        self._events = events
        self._live = live
        self._temperature = TemperatureMonitor(clock, events)
        self._health = health
        self._offer_live = offer_live
        self._settings = taking or CaptureSection()
        self.assembly = Resampler(pipeline.model, settings)
        self._states = DeviceStateTracker(
            clock=clock,
            devices=devices,
            pipeline=pipeline,
            resampler=self.assembly,
            events=events,
            changed=status_changed,
        )
        self._tardiness = LateReadingMonitor(self.assembly, clock, events)
        self.skew = SkewMonitor(settings.skew_limit_mm)
        self.path = TrajectoryBuffer()
        self._uncertainty = uncertainty
        self.quality = QualityMonitor(
            quality or QualitySection(), pipeline.model, clock, events
        )
        self._stage = MeasurementContext(
            clock,
            devices,
            pipeline,
            self.assembly,
            self.skew,
            self.path,
            uncertainty,
            self.quality,
            int(settings.point_wait_s * 1e9),
        )
        self.points = PointController(
            self._stage,
            capture=capture,
            triggers=triggers,
            settings=self._settings,
            events=events,
            health=health,
        )
        self.latches: dict[int, PointFuture] = {}
        self.scans = ScanController(
            scanner, capture=capture, events=events, asked=self.asked
        )
        self.rate_hz = 0.0
        # Points come out of the stream where nothing latches all joints for them.
        self._remembers = not triggers.devices <= set(pipeline.model.devices)
        self._set_batch_window()

    @property
    def clock_device(self) -> Device:
        """The device whose samples' instants are those of the arm's."""
        clock = self.assembly.clock
        return next(d for d in self._devices.devices if d.section.id == clock)

    @property
    def may_wait(self) -> bool:
        """Whether samples or points may ever wait for readings."""
        return self._remembers or not self._devices.is_single

    @property
    def is_idle(self) -> bool:
        """No point is being taken."""
        return self.points.is_idle and not self.latches

    def use(self, configuration: Configuration, model: ArmModel) -> None:
        """Go by another arm file and configuration; only while `is_idle`."""
        capture = self._settings = configuration.capture
        self._triggers = triggers_of(capture)
        self._remembers |= not self._triggers.devices <= set(model.devices)
        self._uncertainty = CovarianceEvaluator(configuration.uncertainty)
        self.use_probe(model)
        self.quality.use(configuration.quality, model)
        self._stage = replace(self._stage, uncertainty=self._uncertainty)
        self.points.use(self._stage, self._triggers, capture)
        self._live.use_rate(capture.live_rate_hz)
        self.scans.use(capture.scan_block_s, configuration.scan)
        self._set_batch_window()

    def use_probe(self, model: ArmModel) -> None:
        """Measure with another probe on the same arm from the next sample on."""
        self._pipeline.use_model(model)
        self.quality.use_model(model)
        self.path.forget()  # it was that of another ball
        self.points.arm_changed()

    @property
    def pipeline_state(self) -> dict[str, object]:
        """What the pipeline needs to go on from the last sample."""
        return self._pipeline.state

    @property
    def model(self) -> ArmModel:
        """The arm that is measured with."""
        return self._pipeline.model

    def asked(self, what: str, **values: object) -> int:
        """A command is about to be carried out; gives its instant [ns]."""
        now_ns = self._clock.step()
        self._tape.asked(now_ns, what, values)
        return now_ns

    def await_latch(self, token: int, answer: PointFuture) -> None:
        """The latch with this token is somebody's point."""
        self.asked("await_latch", token=token)
        self.latches[token] = answer

    def give_up_latch(self, token: int, answer: PointFuture) -> None:
        """Nobody waits for that point any more."""
        if not answer.done():
            self.asked("give_up_latch", token=token)
        self.latches.pop(token, None)
        answer.cancel()

    def process_timeouts(self) -> None:
        """Go on with what has waited long enough; call it every few milliseconds.

        Nothing else looks at the time, so that deliveries which already wait when the
        loop has been busy are taken first.
        """
        now_ns = self._clock.step()
        self._tape.passed(now_ns)
        self._take_assembled(now_ns)
        self.points.settle(now_ns)
        self._tardiness.check()

    def take(self, device: Device, delivery: Delivery) -> None:
        """Deal with one delivery of a device."""
        device.last_ns = self._clock.step()
        self._tape.delivered(device.last_ns, delivery)
        match delivery:
            case CountSamples():
                self._take_samples(device, delivery)
            case LatchedCounts():
                self._take_latch(device, delivery)
            case StreamStarted():
                self._take_stream(delivery)
            case DeviceTemperatures():
                device.temperatures_c = delivery.values_c
                if device in self._devices and self._devices.first_mismatched is None:
                    self._temperature.check(self._pipeline.model, self._devices)
            case DeviceCounters():
                device.counters.clear()
                device.counters.update(delivery.values)
            case DeviceUp():
                self._states.on_up(device, delivery)
                self.quality.persistent.on_device_up(device.section.id)
                if delivery.restarted:
                    self.path.forget()
                # What cannot latch gives its points out of the stream.
                not_latching = not delivery.identity.latches
                self._remembers |= not_latching and device in self._devices
                self._set_batch_window()
            case DeviceLost():
                self._states.on_lost(device, delivery)
            case DeviceAlarm():
                self._states.on_alarm(device, delivery)
                self.quality.persistent.alarm(
                    delivery.device, delivery.channel, delivery.code, delivery.raised
                )
            case DeviceFault():
                self._states.on_fault(device, delivery)

    def _set_batch_window(self) -> None:
        self._devices.set_batch_window(self._settings, may_wait=self.may_wait)

    def _take_samples(self, device: Device, samples: CountSamples) -> None:
        device.samples += len(samples.seq)
        if device not in self._devices or self._devices.first_mismatched is not None:
            return
        waited_ns = self._clock.running.monotonic_ns() - samples.received_ns
        self._health.latencies["queue_wait"].add(waited_ns)
        if self._devices.is_single and samples.skew_ns is None:
            self._measure(samples, None)
            if self._remembers:
                self.assembly.record(samples)
        else:
            self.assembly.add(samples, self._clock.monotonic_ns())
            self._take_assembled()
        self.points.settle()

    def _take_assembled(self, now_ns: int | None = None) -> None:
        for assembled in self.assembly.resampled(now_ns):
            self._measure(assembled.samples, assembled.error_bounds_counts)

    def _measure(
        self, samples: CountSamples, error_bounds_counts: NDArray[np.float64] | None
    ) -> None:
        """Pass samples of the whole arm down the pipeline."""
        model, temperature_c = self._pipeline.model, self._devices.temperature_c
        poses = self._pipeline.poses(samples, temperature_c)
        if error_bounds_counts is not None:
            self.skew.flag_block(model, poses, error_bounds_counts)
        self.quality.flag_block(model, poses, temperature_c)
        taken_ns = self._clock.running.monotonic_ns() - samples.received_ns
        self._health.latencies["sample_to_pose"].add(taken_ns)
        self.path.add(poses)
        self.points.follow(poses)
        self.scans.take(model, poses)
        session = self._capture.session.id
        live = self._live.message(model, poses, session, samples.device)
        if live is not None:
            self._offer_live(self._with_covariance(live, poses, error_bounds_counts))
        self._temperature.check(model, self._devices)

    def _with_covariance(
        self,
        live: Live,
        poses: PoseBlock,
        error_bounds_counts: NDArray[np.float64] | None,
    ) -> Live:
        """What is shown of a block's last pose, with how well it is known."""
        time_ns, angles_rad = int(poses.sample_time_ns[-1]), poses.angles_rad[-1]
        block = self._pipeline.block_at(
            time_ns, angles_rad, self._devices.temperature_c
        )
        reading = CovarianceInput(
            block,
            self.path.speeds_rad_s(time_ns, angles_rad),
            None if error_bounds_counts is None else error_bounds_counts[-1],
        )
        found = self._uncertainty.covariance(self._pipeline.model, reading)
        return live.model_copy(update={"covariance_mm2": found})

    def _take_latch(self, device: Device, latch: LatchedCounts) -> None:
        if latch.input is not None:
            name = device.section.id
            if self._triggers.trigger_of(name, latch.input) == "button":
                self.scans.on_button(name, latch.input, latch)
            self.points.take_edge(device, latch)
        elif (answer := self.latches.pop(latch.token, None)) is not None:
            self.points.add_latched(latch, answer)

    def _take_stream(self, started: StreamStarted) -> None:
        model = self._pipeline.model
        if started.device in model.devices:
            self.assembly.set_rate(started.device, started.rate_hz)
        if started.device == self.assembly.clock:
            self.rate_hz = started.rate_hz
            self.scans.on_stream_started(started)
