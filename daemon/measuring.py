"""What the daemon does with everything that a device delivers.

Runs on the event loop, in plain calls; nothing here waits.
"""

import asyncio
from collections.abc import Callable

from daemon.capture import Capture, Triggers
from daemon.clock import HostClock
from daemon.device import Device
from daemon.events import EventLog
from daemon.health import HealthReport
from daemon.live import LiveView
from daemon.pipeline import Pipeline
from daemon.scanner import Scanner
from daemon.temperature_watch import TemperatureWatch
from drivers.values import (
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
from protocol.messages import Live, Point
from protocol.messages.point import Trigger


class Measuring:
    """Turns deliveries into points, scan blocks, live poses and events.

    Args:
        clock: the host's.
        offer_live: hands a live pose to the outgoing queue.
        status_changed: called when a device's state has changed.
    """

    def __init__(
        self,
        *,
        clock: HostClock,
        pipeline: Pipeline,
        capture: Capture,
        triggers: Triggers,
        scanner: Scanner,
        live: LiveView,
        events: EventLog,
        health: HealthReport,
        offer_live: Callable[[Live], object],
        status_changed: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._pipeline = pipeline
        self._capture = capture
        self._triggers = triggers
        self._scanner = scanner
        self._live = live
        self._events = events
        self._temperature = TemperatureWatch(clock, events)
        self._health = health
        self._offer_live = offer_live
        self._status_changed = status_changed
        self.latches: dict[int, asyncio.Future[Point | None]] = {}
        self.stream_started = asyncio.Event()

    def take(self, device: Device, delivery: Delivery) -> None:
        """Deal with one delivery of a device."""
        device.last_ns = self._clock.monotonic_ns()
        match delivery:
            case CountSamples():
                self._take_samples(device, delivery)
            case LatchedCounts():
                self._take_latch(device, delivery)
            case StreamStarted():
                if self._scanner.follow(delivery.stream, delivery.rate_hz):
                    self.stream_started.set()
            case DeviceTemperatures():
                device.temperatures_c = delivery.values_c
                if self._measures(device):
                    self._temperature.look(self._pipeline.model, device)
            case DeviceCounters():
                device.counters.clear()
                device.counters.update(delivery.values)
            case DeviceUp():
                self._take_up(device, delivery)
            case DeviceLost():
                self._take_lost(device, delivery)
            case DeviceAlarm():
                self._take_alarm(device, delivery)
            case DeviceFault():
                self._events.report(
                    "warning",
                    f"device.{delivery.code}",
                    delivery.text,
                    source=device.section.id,
                    remedy=delivery.remedy,
                    count=delivery.count,
                )

    def _take_samples(self, device: Device, samples: CountSamples) -> None:
        device.samples += len(samples.seq)
        if not self._measures(device):
            return
        waited_ns = self._clock.monotonic_ns() - samples.received_ns
        self._health.latencies["queue_wait"].add(waited_ns)
        model = self._pipeline.model
        poses = self._pipeline.poses(samples, device.temperature_c)
        taken_ns = self._clock.monotonic_ns() - samples.received_ns
        self._health.latencies["sample_to_pose"].add(taken_ns)
        self._scanner.take(model, poses)
        session = self._capture.session.id
        live = self._live.message(model, poses, session, device.section.id)
        if live is not None:
            self._offer_live(live)
        self._temperature.look(model, device)

    def _take_latch(self, device: Device, latch: LatchedCounts) -> None:
        if latch.input is None:
            waiting = self.latches.pop(latch.token, None)
            # Whoever asked and was told "no answer" must not find a point later.
            if waiting is not None and not waiting.done():
                waiting.set_result(self._captured(device, latch, "command"))
            return
        trigger = self._triggers.trigger_of(device.section.id, latch.input)
        if trigger is not None:
            if latch.active:  # the point first: somebody waits for it
                self._captured(device, latch, trigger)
            self._events.report(
                "info",
                f"{trigger}.{'pressed' if latch.active else 'released'}",
                f"{trigger} {'on' if latch.active else 'off'}",
                source=f"{device.section.id}/{latch.input}",
                distinct=True,
            )
        # Only now may the board forget it.
        device.driver.acknowledge(latch.token)

    def _captured(
        self, device: Device, latch: LatchedCounts, trigger: Trigger
    ) -> Point | None:
        if not self._measures(device):
            text = f"{device.section.id} does not fit the arm file"
            self._refused(text, "see the event device.mismatch")
            return None
        temperature_c = device.temperature_c
        pose = self._pipeline.latched_pose(latch, temperature_c)
        point = self._capture.take(self._pipeline.model, pose, trigger, temperature_c)
        if point is None:
            self._refused(
                "the queue of points is full: the broker has not taken them",
                "wait until the broker is back, then take the point again",
            )
        else:
            taken_ns = self._clock.monotonic_ns() - latch.received_ns
            self._health.latencies["capture_to_publish"].add(taken_ns)
        return point

    def _measures(self, device: Device) -> bool:
        """Whether this device's counts are the arm's, as the arm file describes it."""
        own = device.section.id == self._pipeline.model.device
        return own and not device.problems

    def _refused(self, text: str, remedy: str) -> None:
        self._events.report(
            "error", "capture.refused", text, source="capture", remedy=remedy
        )

    def _take_up(self, device: Device, up: DeviceUp) -> None:
        device.identity = up.identity
        device.up_ns = self._clock.monotonic_ns()
        device.temperatures_c = ()  # those of before may have changed meanwhile
        model = self._pipeline.model
        device.problems = []
        if device.section.id == model.device:
            device.problems = model.problems_with(up.identity.moduli_counts)
        for problem in device.problems:
            self._events.report(
                "error",
                "device.mismatch",
                problem,
                source=device.section.id,
                remedy="correct the arm file",
            )
        device.reconnects += device.state == "lost"
        device.state = "failed" if device.problems else "ready"
        if up.restarted:
            # Its absolute encoders go on; where the turns are counted is a guess.
            self._pipeline.restart()
            self._events.report(
                "warning",
                "device.restarted",
                f"{device.section.id} has been without power",
                source=device.section.id,
                remedy="check a known point before measuring on",
            )
        self._events.change(
            False,
            "error",
            "device.lost",
            f"{up.identity.name} is there, firmware {up.identity.firmware}",
            source=device.section.id,
        )
        device.heard.set()
        self._status_changed()

    def _take_lost(self, device: Device, lost: DeviceLost) -> None:
        device.lost = lost
        if device.state != "starting":
            device.state = "lost"
            self._events.change(
                True,
                "error",
                "device.lost",
                lost.reason,
                source=device.section.id,
                remedy=lost.remedy,
            )
        device.heard.set()
        self._status_changed()

    def _take_alarm(self, device: Device, alarm: DeviceAlarm) -> None:
        source = device.section.id
        if alarm.channel is not None:
            source = f"{source}/{alarm.channel}"
        self._events.change(
            alarm.raised,
            "error",
            f"alarm.{alarm.code}",
            f"{alarm.text} (value {alarm.value})",
            source=source,
            remedy=alarm.remedy,
        )
