"""From an edge or a command to the captured point, in order and never twice."""

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
from traverse.daemon.points.observation import Observation
from traverse.daemon.points.request_queue import OrderedReplies, Outcome, RequestQueue
from traverse.daemon.points.requests import (
    EdgeRequest,
    OrderedAct,
    PointRequest,
    Request,
    observation_of,
)
from traverse.daemon.store.records import PendingPoint
from traverse.drivers.base.values import CountSamples, LatchedCounts
from traverse.protocol.messages import Point
from traverse.protocol.messages.point import Trigger

log = logging.getLogger(__name__)


PointFuture = asyncio.Future[Point]
OTHER_ACTIONS = ("scan", "stop", "session")  # done by others, or reported
REPORT_IT = "report it with the daemon's log"
MOVABLE_NS = 150_000_000  # a commanded point, for joints that are known at one instant


class PointController:
    """Take points, and all commands that must keep their order with points.

    Args:
        on_action: called with actions of buttons that are not about points.

    Attributes:
        evaluator: follows the stream; another one after `use`.
        has_pending: set while a request waits for time to pass.
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
        self._pending = RequestQueue()
        self.has_pending = asyncio.Event()
        self._answers = OrderedReplies(self._report_outcome)

    def arm_changed(self) -> None:
        """Use another arm from now on, also for waiting requests."""
        self.evaluator.arm_changed()
        for observation in self._pending.observations:
            observation.begin_anew()
            self.evaluator.look(observation)

    @property
    def is_idle(self) -> bool:
        """No point is being taken or stored, and no press is being classified."""
        return not (self._pending or self._answers) and self._buttons.all_decided

    def use(self, settings: CaptureSection) -> None:
        """Follow other rules; only while `is_idle`."""
        self.triggers = triggers_of(settings)
        self._buttons = buttons_of(settings)
        self.evaluator = PointEvaluator(self._stage, settings, self._events)

    def settle(self, now_ns: int | None = None) -> None:
        """Take all points that can be taken; refuse requests that wait too long."""
        pending = self._pending
        if not pending:
            return
        if now_ns is not None:
            self._buttons.passed(now_ns)
        for observation in pending.observations:
            if not observation.is_complete:
                self.evaluator.look(observation)
        while pending:
            if not self._deal_with(pending.first, pending.must_not_wait(now_ns)):
                self.has_pending.set()
                return
            pending.remove_first()
        self.has_pending.clear()

    # -- requests for points --------------------------------------------------

    def follow_levels(self, samples: CountSamples) -> None:
        """Note the levels of a device's inputs."""
        self._buttons.follow_levels(samples)

    def take_edge(
        self, device: Device, latch: LatchedCounts, *, counts: bool = True
    ) -> None:
        """Process an edge, and only then acknowledge it to the device.

        One that does not count is acknowledged in its turn, no more.
        """
        name, number = device.section.id, latch.input
        trigger = self.triggers.get((name, number)) if counts else None
        request = EdgeRequest(device, latch, trigger, self._deadline_ns())
        if trigger is not None and latch.active:
            request.observation = Observation(
                latch.sample_time_ns,
                request.deadline_ns,
                latch=latch,
                is_edge=True,
                time_bound_ns=_bound_ns(device, latch),
            )
        if trigger == "button" and number is not None:
            which, time_ns = (name, number), latch.sample_time_ns
            if latch.active:
                request.press = self._buttons.down(which, time_ns)
            else:
                request.ends = self._buttons.up(which, time_ns)
        self._add(request)

    def take_now(self) -> PointFuture:
        return self._take_from_now(None)

    def add_latched(
        self,
        device: Device,
        latch: LatchedCounts,
        answer: PointFuture,
        requested_by: str | None,
    ) -> None:
        deadline_ns = self._deadline_ns()
        seen = Observation(
            latch.sample_time_ns,
            deadline_ns,
            latch=latch,
            time_bound_ns=_bound_ns(device, latch),
        )
        self._add(
            PointRequest(
                latch.received_ns, deadline_ns, answer, seen, requested_by=requested_by
            )
        )

    def take_mean(self, average: SampleAverage) -> PointFuture:
        return self._take_from_now(average)

    def in_order(self, act: Callable[[], Any]) -> asyncio.Future[Any]:
        """Call a function after all points that were requested before."""
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._add(OrderedAct(self._now_ns(), self._deadline_ns(), answer, act))
        return answer

    def _take_from_now(self, average: SampleAverage | None) -> PointFuture:
        now_ns, deadline_ns = self._now_ns(), self._deadline_ns()
        movable_ns = min(MOVABLE_NS, self._stage.point_wait_ns // 2)
        observation = Observation(
            now_ns, deadline_ns, movable_until_ns=now_ns + movable_ns
        )
        if average is not None:
            self.evaluator.start_average(observation, average)
        answer: PointFuture = asyncio.get_running_loop().create_future()
        self._add(PointRequest(now_ns, deadline_ns, answer, observation))
        return answer

    def _add(self, request: Request) -> None:
        self._pending.add(request)
        self.settle()

    def _deadline_ns(self) -> int:
        return self._now_ns() + self._stage.point_wait_ns

    def report(self, code: str, text: str, data: dict[str, str] | None = None) -> None:
        self._events.report("info", code, text, data=data, distinct=True)

    def begin_session(self, note: str = "") -> Session:
        session = self._capture.begin_session(note)
        text = f"session {session.id} begins{': ' if note else ''}{note}"
        self.report("capture.session", text)
        return session

    # -- results ---------------------------------------------------------------

    def _deal_with(self, request: Request, is_last_chance: bool) -> bool:
        """Deal with a request; return False while it has to wait."""
        outcome: Outcome = True
        requested_by = None
        if isinstance(request, EdgeRequest):
            if request.press is not None and request.press.action is None:
                return False
            is_wanted = True
        else:  # no point is created after its requester has timed out
            is_wanted, requested_by = not request.answer.done(), request.requested_by
        if is_wanted:
            within = CURRENT_REQUEST.set(requested_by)
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
        observation = observation_of(request)
        if observation is not None:
            self.evaluator.forget(observation)
        self._answers.add(request, outcome)
        return True

    def _outcome(self, request: Request, is_last_chance: bool) -> object:
        """Result of a request; None while it is pending.

        Raises:
            CaptureRefusedError: nothing, for a reason.
        """
        match request:
            case OrderedAct():
                return request.act()
            case PointRequest(observation=observation):
                return self._point(observation, "command", is_last_chance)
            case EdgeRequest(observation=Observation() as observation) if (
                request.captures and request.trigger is not None
            ):
                press = request.press
                is_mean = press is not None and press.action == "average"
                if is_mean and observation.average is None:
                    self.evaluator.start_average(observation)
                return self._point(observation, request.trigger, is_last_chance)
            case EdgeRequest():
                return self._action_done(request, is_last_chance=is_last_chance)

    def _point(
        self, observation: Observation, trigger: Trigger, is_last_chance: bool
    ) -> PendingPoint | None:
        measured = self.evaluator.measured(
            observation,
            is_last_chance=is_last_chance,
            is_crowded=self._pending.is_crowded,
        )
        if measured is None:
            return None
        self._stage.quality.check(measured.pose.quality)
        return self._capture.take(measured, trigger)

    def _action_done(self, edge: EdgeRequest, *, is_last_chance: bool) -> object:
        """Do an edge's action that takes no point; None while that has to wait."""
        action = None if edge.press is None else edge.press.action
        if edge.ends is not None and edge.ends.action == "scan":
            action = "stop"
        outcome: object = True
        if action == "undo" and edge.trigger is not None:
            outcome = self._capture.undo(edge.trigger)
        elif action == "air" and edge.observation is not None:
            if not self.evaluator.set_air_point(
                edge.observation, is_last_chance=is_last_chance
            ):
                return None
        elif action == "session":
            self.begin_session()
        if action in OTHER_ACTIONS:
            self._on_action(action)
        return outcome

    def _report_outcome(self, request: Request, outcome: Outcome) -> None:
        """Answer a request: its point is on the disk, or there is none."""
        if isinstance(outcome, CaptureRefusedError):
            self._capture.refused += request.captures
            self._events.report(
                "error", "capture.refused", str(outcome), remedy=outcome.remedy
            )
        elif isinstance(outcome, Point) and outcome.retracts is None:
            now_ns = self._stage.clock.running.monotonic_ns()
            latency = self._latencies["capture_to_publish"]
            latency.add(now_ns - request.received_ns)
        elif isinstance(outcome, Point) and isinstance(request, EdgeRequest):
            self.report("capture.undone", f"{outcome.retracts} is taken back")
        if isinstance(request, EdgeRequest):
            self._report_edge(request)
            # Only now may the device drop it.
            request.device.driver.acknowledge(request.latch.token)
        else:
            request.resolve(outcome)

    def _report_edge(self, edge: EdgeRequest) -> None:
        trigger, press, latch = edge.trigger, edge.press, edge.latch
        if trigger is None:
            return
        level, way = ("on", "pressed") if latch.active else ("off", "released")
        texts = {f"{trigger}.{way}": f"{trigger} {level}"}
        if press is not None and press.gesture not in ("click", "part", None):
            texts[f"{trigger}.{press.gesture}"] = f"{press.gesture}: {press.action}"
        source = f"{edge.device.section.id}/{latch.input}"
        for code, text in texts.items():
            self._events.report("info", code, text, source=source, distinct=True)

    def _now_ns(self) -> int:
        return self._stage.clock.monotonic_ns()


def _bound_ns(device: Device, latch: LatchedCounts) -> int:
    """Return how far the instant of a latch may be off; 0: nothing states it."""
    stated_ns = 0 if device.identity is None else device.identity.jitter_ns
    return latch.time_bound_ns or stated_ns
