"""Points: from an edge or a command to the capture, in order and never twice."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any

from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.schema import Action, CaptureSection
from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.points.averaging import SampleAverage
from traverse.daemon.points.buttons import buttons_of
from traverse.daemon.points.capture import Capture, Session, triggers_of
from traverse.daemon.points.measurement import MeasurementContext, PointEvaluator
from traverse.daemon.points.request_queue import (
    OrderedReplies,
    Outcome,
    PointRequest,
    PointRequestQueue,
)
from traverse.drivers.base.values import LatchedCounts
from traverse.protocol.messages import Point
from traverse.protocol.messages.point import Trigger

log = logging.getLogger(__name__)


PointFuture = asyncio.Future[Point]
OTHER_ACTIONS = ("scan", "stop", "session")  # done by others, or reported
REPORT_IT = "report it with the daemon's log"


class PointController:
    """Takes points, and all commands that must keep their order with points.

    Args:
        on_action: called with actions of buttons that are not about points.

    Attributes:
        evaluator: follows the stream; another one after `use`.
    """

    def __init__(
        self,
        stage: MeasurementContext,
        *,
        capture: Capture,
        settings: CaptureSection,
        events: EventLog,
        latencies: Mapping[str, Latencies],
        on_action: Callable[[Action], object],
    ) -> None:
        self._stage = stage
        self._capture = capture
        self._events = events
        self.use(settings)
        self._latencies = latencies
        self._on_action = on_action
        self._pending = PointRequestQueue(self._look, self._deal_with)
        self._answers = OrderedReplies(self._tell)

    def arm_changed(self) -> None:
        """Use another arm from now on, also for requests that wait."""
        self.evaluator.arm_changed()
        self._pending.look_again()

    @property
    def is_idle(self) -> bool:
        """No point is being taken or stored, and no press is being classified."""
        return not (self._pending or self._answers) and self._buttons.all_decided

    def use(self, settings: CaptureSection) -> None:
        """Go by other rules; only while `is_idle`."""
        self.triggers = triggers_of(settings)
        self._buttons = buttons_of(settings)
        self.evaluator = PointEvaluator(self._stage, settings, self._events)

    @property
    def has_pending(self) -> asyncio.Event:
        """Set while something waits for time to pass."""
        return self._pending.some

    def settle(self, now_ns: int | None = None) -> None:
        """Take all points that can be taken; refuse what waits beyond some time."""
        if self._pending:
            if now_ns is not None:
                self._buttons.passed(now_ns)
            self._pending.settle(now_ns)

    # -- requests for points --------------------------------------------------

    def take_edge(self, device: Device, latch: LatchedCounts) -> None:
        """Process an edge, and only then acknowledge it to the device."""
        name, number = device.section.id, latch.input
        trigger = self.triggers.get((name, number))
        request = self._request_of(latch, trigger)
        request.device = device
        if trigger == "button" and number is not None:
            which, time_ns = (name, number), latch.sample_time_ns
            if latch.active:
                request.press = self._buttons.down(which, time_ns)
            else:
                request.ends = self._buttons.up(which, time_ns)
        self._pending.add(request)

    def take_now(self) -> PointFuture:
        """Take a point at this very instant, out of the stream."""
        return self._asked(self._request_now("command"))

    def add_latched(
        self, latch: LatchedCounts, answer: PointFuture, requested_by: str | None
    ) -> None:
        """Take a point of what a device has latched on request."""
        request = self._request_of(latch, "command")
        request.answer, request.requested_by = answer, requested_by
        self._pending.add(request)

    def take_mean(self, average: SampleAverage) -> PointFuture:
        """Take a point that is the mean of the samples from now on."""
        request = self._request_now("command")
        self.evaluator.start_average(request, average)
        return self._asked(request)

    def in_order(self, act: Callable[[], Any]) -> asyncio.Future[Any]:
        """Do this after all points that were requested before."""
        request = self._request_now(None)
        request.act = act
        return self._asked(request)

    def _request_of(
        self, latch: LatchedCounts, trigger: Trigger | None
    ) -> PointRequest:
        until_ns = self._now_ns() + self._stage.point_wait_ns
        times_ns = latch.sample_time_ns, latch.received_ns, until_ns
        return PointRequest(*times_ns, trigger, latch=latch)

    def _request_now(self, trigger: Trigger | None) -> PointRequest:
        now_ns = self._now_ns()
        return PointRequest(now_ns, now_ns, now_ns + self._stage.point_wait_ns, trigger)

    def _asked(self, request: PointRequest) -> asyncio.Future[Any]:
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        request.answer = answer
        self._pending.add(request)
        return answer

    def report(self, code: str, text: str, data: dict[str, str] | None = None) -> None:
        """Report what has changed, each time it does."""
        self._events.report("info", code, text, data=data, distinct=True)

    def begin_session(self, note: str = "") -> Session:
        """Number points from 0 again."""
        session = self._capture.begin_session(note)
        text = f"session {session.id} begins{': ' if note else ''}{note}"
        self.report("capture.session", text)
        return session

    # -- results ---------------------------------------------------------------

    def _look(self, request: PointRequest) -> None:
        self.evaluator.look(request)

    def _deal_with(self, request: PointRequest, is_last_chance: bool) -> bool:
        press, answer = request.press, request.answer
        if press is not None and press.action is None:
            return False
        outcome: Outcome = True
        # Do not create a point after its requester has timed out.
        if answer is None or not answer.done():
            within = CURRENT_REQUEST.set(request.requested_by)
            try:
                outcome = self._outcome(request, is_last_chance)
            except CaptureRefusedError as error:
                outcome = error
            except Exception as error:  # what follows it must not wait for ever
                log.exception("fault while a point was taken")
                outcome = CaptureRefusedError(repr(error), REPORT_IT)
            finally:
                CURRENT_REQUEST.reset(within)
            if outcome is None:
                return False
        self.evaluator.forget(request)
        self._answers.add(request, outcome)
        return True

    def _tell(self, request: PointRequest, outcome: Outcome) -> None:
        """Answer a request: its point is on the disk, or there is none."""
        if isinstance(outcome, CaptureRefusedError):
            self._capture.refused += request.captures
            self._events.report(
                "error", "capture.refused", str(outcome), remedy=outcome.remedy
            )
        elif isinstance(outcome, Point) and outcome.retracts is None:
            now_ns = self._stage.clock.running.monotonic_ns()
            taken = self._latencies["capture_to_publish"]
            taken.add(now_ns - request.received_ns)
        elif isinstance(outcome, Point) and request.device is not None:
            self.report("capture.undone", f"{outcome.retracts} is taken back")
        request.resolve(outcome)
        if request.device is not None and request.latch is not None:
            self._report_edge(request, request.device, request.latch)
            # Only now may the device drop it.
            request.device.driver.acknowledge(request.latch.token)

    def _report_edge(
        self, request: PointRequest, device: Device, latch: LatchedCounts
    ) -> None:
        """An edge was dealt with: first what it was, then the gesture it made."""
        trigger, press = request.trigger, request.press
        if trigger is None:
            return
        level, way = ("on", "pressed") if latch.active else ("off", "released")
        told = {f"{trigger}.{way}": f"{trigger} {level}"}
        if press is not None and press.gesture not in ("click", "part", None):
            told[f"{trigger}.{press.gesture}"] = f"{press.gesture}: {press.action}"
        source = f"{device.section.id}/{latch.input}"
        for code, text in told.items():
            self._events.report("info", code, text, source=source, distinct=True)

    def _outcome(self, request: PointRequest, is_last_chance: bool) -> object:
        """The result of a request; None while it is pending.

        Raises:
            CaptureRefusedError: nothing, for a reason.
        """
        if request.act is not None:
            return request.act()
        if not request.captures or request.trigger is None:
            return self._done(request, is_last_chance=is_last_chance)
        press = request.press
        if press is not None and press.action == "average" and request.average is None:
            self.evaluator.start_average(request)
        measured = self.evaluator.measured(
            request, is_last_chance=is_last_chance, is_crowded=self._pending.is_crowded
        )
        if measured is None:
            return None
        self._stage.quality.check(measured.pose.quality)
        return self._capture.take(measured, request.trigger)

    def _done(self, request: PointRequest, *, is_last_chance: bool) -> object:
        """Do what an edge means that takes no point; None while that has to wait."""
        action = None if request.press is None else request.press.action
        if request.ends is not None and request.ends.action == "scan":
            action = "stop"
        outcome: object = True
        if action == "undo" and request.trigger is not None:
            outcome = self._capture.undo(request.trigger)
        elif action == "air":
            if not self.evaluator.set_air_point(request, is_last_chance=is_last_chance):
                return None
        elif action == "session":
            self.begin_session()
        if action in OTHER_ACTIONS:
            self._on_action(action)
        return outcome

    def _now_ns(self) -> int:
        return self._stage.clock.monotonic_ns()
