"""Replay of a recording by its own times.

Every step is taken at its recorded instant, the only input that points depend on.
Blocks of samples may be cut, or joined if nothing lies between.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from traverse.daemon.acquisition.device import Device
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import Configuration
from traverse.daemon.executor import recorded_command
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.recorder.file import STEPS
from traverse.daemon.recorder.item_queue import WARM_UP_NS
from traverse.daemon.recorder.recorded_inputs import read_recorded_inputs
from traverse.daemon.replay.compare import (
    ULPS,
    PointComparison,
    ReplayResult,
    ScanComparison,
)
from traverse.daemon.replay.restoring import restore
from traverse.daemon.step_listener import StepListener
from traverse.daemon.store.records import PendingPoint
from traverse.drivers.base.delivery_maps import delivery_from_map
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import CountSamples, Delivery
from traverse.kinematics.model.kernel_choice import KERNEL
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point, Scan
from traverse.recording.maps import bytes_to_map
from traverse.recording.run_reader import RunReader
from traverse.recording.run_writer import Entry
from traverse.recording.views import bytes_to_cloud


class ReplayClock(HostClock):
    """Clock set to the instants of the recording."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.offset_ns = 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def utc_offset_ns(self) -> int:
        return self.offset_ns


class AbsentDriver(Driver):
    """Driver of an absent device, whose deliveries are in the recording."""

    def request_stream(self, rate_hz: float) -> None:
        """Do nothing; the recording has the streams."""

    def _connect(self) -> None:
        """Never called, since it is not started."""

    def _serve(self) -> None:
        """Never called."""

    def _disconnect(self) -> None:
        """Never called."""


def replay_measurement(
    configuration: Configuration,
    model: ArmModel,
    clock: ReplayClock,
    *,
    take_point: Callable[[Point], object],
    take_scan: Callable[[Scan], object],
    listener: StepListener | None = None,
) -> Measurement:
    """Create the measuring path on absent devices; needs a running event loop."""

    def write_point(point: Point, begun_ns: int, note: str) -> PendingPoint:
        written = PendingPoint(point)
        written.settle()
        take_point(point)
        return written

    def offer_scan(scan: Scan, on_dropped: Callable[[], object]) -> bool:
        take_scan(scan)
        return True

    loop = asyncio.get_running_loop()
    devices = [
        Device(
            section,
            DeliveryQueue(loop),
            AbsentDriver(section.id, section.options, DeliveryQueue(loop)),
        )
        for section in configuration.device
    ]
    sinks = Sinks(EventLog(clock, lambda event: None), write_point, offer_scan)
    return Measurement(configuration, model, sinks, clock, listener, devices=devices)


def close_drivers(measurement: Measurement) -> None:
    for device in measurement.devices.values():
        device.driver.close()


@dataclass(eq=False)
class Replay:
    """Replays one recording; needs a running event loop.

    Args:
        block: size to which blocks of samples are cut or joined; None: as recorded.
    """

    reader: RunReader
    block: int | None = None
    _: KW_ONLY
    take_point: Callable[[Point], object] = lambda point: None
    take_scan: Callable[[Scan], object] = lambda scan: None

    def __post_init__(self) -> None:
        self._clock = ReplayClock()
        self._measurement: Measurement | None = None
        then = self.reader.about.get("kernel", "?")
        self._points = PointComparison(is_recut=self.block is not None)
        self._scans = ScanComparison()
        self._result = ReplayResult(self._points, self._scans, then, KERNEL)
        self._has_begun = False
        self._sure_ns = 0
        self._joined: list[CountSamples] = []

    def run(self) -> ReplayResult:
        """Take all steps.

        Raises:
            ValueError: the recording is inconsistent.
            OSError: it cannot be read.
        """
        try:
            for entry in self.reader:
                self._take(entry)
            self._flush()
        except (KeyError, TypeError, AttributeError, IndexError, MessageError) as error:
            raise ValueError(
                f"{self.reader.path}: a step makes no sense: {error!r}; was it "
                "recorded by this version?"
            ) from error
        finally:
            if self._measurement is not None:
                close_drivers(self._measurement)
        if not self._has_begun:
            tear = f" ({self.reader.tear})" if self.reader.tear else ""
            raise ValueError(f"{self.reader.path}: no state to begin with{tear}")
        self._scans.settle(self._points.tolerance_mm)
        self._result.tear = self.reader.tear
        return self._result

    def _take(self, entry: Entry) -> None:
        match entry.topic.split("/"):
            case ["point"] if self._has_begun:
                self._points.was(Point.model_validate_json(entry.content))
            case ["cloud"] if self._has_begun:
                cloud = bytes_to_cloud(entry.content)
                self._scans.then[cloud.scan].append(cloud.points)
            case ["device", _, _]:
                self._deliver(entry)
            case [topic] if topic == STEPS:
                table = bytes_to_map(entry.content)
                if table["is"] == "state":
                    self._flush()
                    self._begin(entry, table)
                elif self._measurement is not None:
                    self._flush()
                    self._set_clock(entry, table)
                    self._step(self._measurement, table)

    def _set_clock(self, entry: Entry, table: Mapping[str, Any]) -> None:
        self._clock.now_ns = table["at_ns"]
        self._clock.offset_ns = entry.log_ns - table["at_ns"]

    def _begin(self, entry: Entry, table: Mapping[str, Any]) -> None:
        if self._measurement is not None:
            return
        self._set_clock(entry, table)
        state = table["value"]
        configuration, model = read_recorded_inputs(self.reader.files, state["probe"])
        measurement = replay_measurement(
            configuration,
            model,
            self._clock,
            take_point=self._take_new,
            take_scan=self._take_new_scan,
        )
        self._measurement = measurement
        restore(measurement, state)
        self._sure_ns = 0 if state["fresh"] else table["at_ns"] + WARM_UP_NS
        if not self._has_begun:
            self._has_begun = True
            reach_mm = float(
                np.linalg.norm(model.geometry.links_mm, axis=1).sum()
                + np.abs(model.geometry.origin_mm).max()
            )
            self._points.tolerance_mm = ULPS * float(np.spacing(reach_mm))

    def _step(self, measurement: Measurement, table: Mapping[str, Any]) -> None:
        match table["is"]:
            case "passed":
                measurement.process_timeouts()
            case "asked" if table["what"] == "not_kept":
                self._points.not_kept += 1
            case "asked":
                if table["what"] == "start_scan":
                    self._scans.begun.add(table["value"]["id"])
                command = recorded_command(table["what"], table["value"])
                ignore_result(command.execute(measurement))
            case "files":
                measurement.apply_settings(
                    *read_recorded_inputs(self.reader.files, table["value"]["probe"])
                )
            case "gap":
                self._result.gaps += 1
                self._scans.begun.clear()
                close_drivers(measurement)
                self._measurement = None

    def _deliver(self, entry: Entry) -> None:
        if self._measurement is None:
            return
        table = bytes_to_map(entry.content)
        delivery = delivery_from_map(table)
        if isinstance(delivery, CountSamples):
            self._result.samples += len(delivery.seq)
            self._join(entry, table, delivery)
            return
        self._flush()
        self._set_clock(entry, table)
        deliver(self._measurement, delivery)

    def _join(
        self, entry: Entry, table: Mapping[str, Any], samples: CountSamples
    ) -> None:
        measurement, block = self._measurement, self.block
        if measurement is None:
            return
        if block is None or len(measurement.model.devices) > 1:
            # Where devices wait for each other, times of steps count, too.
            self._set_clock(entry, table)
            for part in _cut(samples, block):
                deliver(measurement, part)
            return
        waiting = self._joined
        if waiting and (
            waiting[-1].stream != samples.stream
            or waiting[-1].device != samples.device
            or self._clock.offset_ns != entry.log_ns - table["at_ns"]
        ):
            self._flush()
        self._set_clock(entry, table)
        waiting.append(samples)
        if sum(len(s.seq) for s in waiting) >= block:
            self._flush()

    def _flush(self) -> None:
        waiting, self._joined = self._joined, []
        if waiting and self._measurement is not None:
            for part in _cut(CountSamples.joined(waiting), self.block):
                deliver(self._measurement, part)

    def _take_new(self, point: Point) -> None:
        now_ns = point.time_ns - self._clock.offset_ns
        self._points.is_now(point, early=now_ns < self._sure_ns)
        self.take_point(point)

    def _take_new_scan(self, scan: Scan) -> None:
        self._scans.now[scan.scan].append(scan)
        self.take_scan(scan)


def _cut(samples: CountSamples, block: int | None) -> list[CountSamples]:
    n = len(samples.seq)
    if block is None or n <= block:
        return [samples]
    return [samples.rows(slice(start, start + block)) for start in range(0, n, block)]


def deliver(measurement: Measurement, delivery: Delivery) -> None:
    device = measurement.devices.get(delivery.device)
    if device is not None:
        measurement.dispatch(device, delivery)


def ignore_result(result: object) -> None:
    """Ignore the result of a command, also a refusal."""
    if isinstance(result, asyncio.Future):
        result.add_done_callback(lambda done: done.cancelled() or done.exception())
