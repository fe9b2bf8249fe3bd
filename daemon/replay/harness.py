"""All that measures, without devices and without a broker: the same calls in order."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import Configuration
from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.health import HealthReport
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.averaging import AverageLimits, SampleAverage
from traverse.daemon.points.capture import Capture, triggers_of
from traverse.daemon.pose.alignment import (
    ActiveAlignment,
    Alignment,
    requested_alignment,
)
from traverse.daemon.pose.arm_model import ArmModel, model_with_probe
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.probe_library import LibraryProbe
from traverse.daemon.pose.uncertainty import CovarianceEvaluator
from traverse.daemon.recorder.snapshot import check_model
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.scans.scanner import Scanner
from traverse.daemon.step_listener import StepListener
from traverse.daemon.store.records import PendingWrite
from traverse.drivers.base.delivery_maps import delivery_from_map
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import AlignArgs, Label, Point, Scan


class ReplayClock(HostClock):
    """Stands at the instants that the recording tells."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.offset_ns = 0

    def monotonic_ns(self) -> int:
        """The instant of the step."""
        return self.now_ns

    def utc_offset_ns(self) -> int:
        """As it was then."""
        return self.offset_ns


class ReplayDriver(Driver):
    """Of a device that is not there: what it delivered comes out of the recording."""

    def request_stream(self, rate_hz: float) -> None:
        """Nobody to ask."""

    def _connect(self) -> None:
        """Never called, since it is not started."""

    def _serve(self) -> None:
        """Never called either."""

    def _disconnect(self) -> None:
        """Nor this."""


class ReplayHarness:
    """Measures what it is given.

    Args:
        configuration, model: of the recording.
        clock: stands at its instants.
        take_point: called with each point.
        take_scan: called with each block of a scan.
        tape: told of each step.

    Attributes:
        capture: where points are numbered.
    """

    def __init__(
        self,
        configuration: Configuration,
        model: ArmModel,
        clock: ReplayClock,
        *,
        take_point: Callable[[Point], object],
        take_scan: Callable[[Scan], object],
        tape: StepListener | None = None,
    ) -> None:
        self.configuration = configuration
        self._clock = clock
        self._take_point = take_point
        self._take_scan = take_scan
        loop = asyncio.get_running_loop()
        self.devices = {
            section.id: Device(
                section,
                DeliveryQueue(loop),
                ReplayDriver(section.id, section.options, DeliveryQueue(loop)),
            )
            for section in configuration.device
        }
        settings = configuration.capture
        part = ActiveAlignment()
        events = EventLog(clock, lambda what: None)
        self.capture = Capture(clock, self._keep, part)
        self._pipeline = Pipeline(model, clock)
        self._scanner = Scanner(
            clock, self._offer_scan, settings.scan_block_s, configuration.scan, part
        )
        self.measuring = Measuring(
            clock=clock,
            devices=JointDevices(model, list(self.devices.values())),
            settings=configuration.assembly,
            uncertainty=CovarianceEvaluator(configuration.uncertainty),
            pipeline=self._pipeline,
            capture=self.capture,
            triggers=triggers_of(settings),
            scanner=self._scanner,
            live=LivePoseSampler(clock, settings.live_rate_hz, part),
            events=events,
            health=HealthReport(clock),
            offer_live=lambda live: None,
            status_changed=lambda: None,
            taking=settings,
            quality=configuration.quality,
            tape=tape,
        )
        self._answers: dict[int, asyncio.Future[Point]] = {}

    def close(self) -> None:
        """Let go of what drivers hold even when they are not there."""
        for device in self.devices.values():
            device.driver.close()

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from a state.

        Raises:
            ValueError: it is of another arm.
            KeyError: it lacks something.
        """
        check_model(state, self._pipeline.model)
        for table in state["devices"]:
            self.take(delivery_from_map(table))
        if not state["fresh"]:
            self._pipeline.resume(state["pipeline"])
        self.capture.session.id = state["session"]
        self.capture.session.next_seq = state["next_seq"]
        self.capture.label = Label(**state["label"])
        alignment, air_mm = state["alignment"], state["air_mm"]
        if alignment is not None:
            self.capture.part.alignment = Alignment(**alignment)
        if air_mm is not None:
            self.measuring.points.tip.set_air_point(np.array(air_mm))
        self.measuring.quality.persistent.resume(state["temperatures"])

    def take(self, delivery: Delivery) -> None:
        """A device delivers something."""
        device = self.devices.get(delivery.device)
        if device is not None:
            self.measuring.take(device, delivery)

    def ask(self, what: str, values: Mapping[str, Any]) -> None:
        """Somebody asks for something."""
        points = self.measuring.points
        match what:
            case "take_now":
                _unheard(points.take_now())
            case "take_mean":
                limits = AverageLimits(values["speed_mm_s"], values["spread_mm"])
                average = SampleAverage(
                    self._clock.now_ns, values["samples"], values["dwell_ns"], limits
                )
                _unheard(points.take_mean(average))
            case "await_latch":
                answer: asyncio.Future[Point] = (
                    asyncio.get_running_loop().create_future()
                )
                _unheard(answer)
                self._answers[values["token"]] = answer
                self.measuring.await_latch(values["token"], answer)
            case "give_up_latch":
                given_up = self._answers.pop(values["token"], None)
                if given_up is not None:
                    self.measuring.give_up_latch(values["token"], given_up)
            case "start_scan":
                self.measuring.scans.start(ScanPlan(**values), self.measuring.model)
            case "stop_scan":
                self.measuring.scans.stop()
            case _:
                self._change(what, values)

    def _change(self, what: str, values: Mapping[str, Any]) -> None:
        """Something that has its turn after all points asked for before."""
        capture, measuring = self.capture, self.measuring

        def change() -> object:
            match what:
                case "undo":
                    return capture.undo("command", values["id"])
                case "label":
                    capture.label = Label(**values)
                case "session":
                    capture.begin_session(values["note"])
                case "align":
                    asked = AlignArgs(**values)
                    capture.part.alignment = requested_alignment(asked)
                case "probe":
                    chosen = LibraryProbe.model_validate_json(values["probe"])
                    try:
                        model = model_with_probe(measuring.model, chosen)
                    except ValueError as error:
                        raise CaptureRefusedError(str(error), "") from error
                    measuring.use_probe(model)
            return True

        if what in ("undo", "label", "session", "align", "probe"):
            _unheard(measuring.points.in_order(change))

    def use(self, configuration: Configuration, model: ArmModel) -> None:
        """Other files are in force."""
        self.configuration = configuration
        self.measuring.use(configuration, model)

    def _keep(self, point: Point, begun_ns: int, note: str) -> PendingWrite:
        keeping = PendingWrite(point)
        keeping.settle()
        self._take_point(point)
        return keeping

    def _offer_scan(self, scan: Scan) -> bool:
        self._take_scan(scan)
        return True


def _unheard(answer: "asyncio.Future[Any]") -> None:
    """Nobody waits for this answer, and nobody minds a refusal."""
    answer.add_done_callback(lambda done: done.cancelled() or done.exception())
