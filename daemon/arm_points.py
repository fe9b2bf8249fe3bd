"""Points: from an edge or a command to the capture, in order and never twice."""

import asyncio
from dataclasses import dataclass, replace

from daemon.arm_devices import ArmDevices
from daemon.assembly import Assembly
from daemon.capture import Capture, Triggers
from daemon.clock import HostClock
from daemon.device import Device
from daemon.events import EventLog
from daemon.health import HealthReport
from daemon.pending_points import PendingPoints, Request
from daemon.pipeline import Pipeline
from daemon.poses import LatchedPose
from daemon.skew import SkewWatch
from daemon.tip_path import TipPath
from daemon.uncertainty import Reading, Uncertainty
from drivers.values import LatchedCounts
from protocol.messages import Point
from protocol.messages.point import Covariance, Trigger

Answer = asyncio.Future[Point]


class CaptureRefusedError(Exception):
    """No point was taken; the text says why."""

    def __init__(self, text: str, remedy: str) -> None:
        super().__init__(text)
        self.remedy = remedy


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """What points are made with.

    Attributes:
        point_wait_ns: how long a point waits for the readings after its instant.
    """

    clock: HostClock
    devices: ArmDevices
    pipeline: Pipeline
    assembly: Assembly
    skew: SkewWatch
    path: TipPath
    uncertainty: Uncertainty
    point_wait_ns: int


class ArmPoints:
    """Takes points.

    Args:
        stage: what they are made with.
        capture: numbers them and hands them on.
        triggers: which edges capture.
        events: where edges and refusals are told.
        health: where it is told how long it took.
    """

    def __init__(
        self,
        stage: Stage,
        capture: Capture,
        triggers: Triggers,
        events: EventLog,
        health: HealthReport,
    ) -> None:
        self._stage = stage
        self._capture = capture
        self._triggers = triggers
        self._events = events
        self._health = health
        self._pending = PendingPoints(self._deal_with)

    def settle(self, now_ns: int | None = None) -> None:
        """Take all points that can be taken; refuse what waits beyond some time."""
        if self._pending:
            self._pending.settle(now_ns)

    def take_edge(self, device: Device, latch: LatchedCounts) -> None:
        """Deal with an edge, and only then tell the device so."""
        now_ns = self._stage.clock.monotonic_ns()
        request = Request(
            latch.sample_time_ns,
            latch.received_ns,
            now_ns + self._stage.point_wait_ns,
            self._triggers.trigger_of(device.section.id, latch.input),
            device,
            latch,
        )
        self._pending.add(request)

    def take_now(self) -> Answer:
        """Take a point at this very instant, out of the stream."""
        answer: Answer = asyncio.get_running_loop().create_future()
        now_ns = self._stage.clock.monotonic_ns()
        deadline_ns = now_ns + self._stage.point_wait_ns
        request = Request(now_ns, now_ns, deadline_ns, "command", answer=answer)
        self._pending.add(request)
        return answer

    def take_latched(self, latch: LatchedCounts, answer: Answer) -> None:
        """Take a point of what a device has latched on request."""
        if answer.done():
            return  # whoever was told "no answer" must not find a point later
        request = Request(latch.sample_time_ns, latch.received_ns, 0, "command")
        _tell(answer, self._outcome(request, self._latched_pose(latch)))

    def _deal_with(self, request: Request, is_last_chance: bool) -> bool:
        given_up = request.answer is not None and request.answer.done()
        if request.captures and not given_up:
            pose = self._pose(request)
            may_come = self._stage.devices.unfit is None and not is_last_chance
            if pose is None and may_come:
                return False
            outcome = self._outcome(request, pose)  # the point first: somebody waits
            if request.answer is not None:
                _tell(request.answer, outcome)
        if request.device is not None and request.latch is not None:
            self._tell_edge(request.device, request.latch, request.trigger)
            # Only now may the device forget it.
            request.device.driver.acknowledge(request.latch.token)
        return True

    def _pose(self, request: Request) -> LatchedPose | None:
        """The arm at the instant of a request; None while that is not known."""
        stage, latch = self._stage, request.latch
        if stage.devices.unfit is not None:
            return None
        if latch is not None and latch.counts and stage.devices.alone:
            device = stage.devices.all[0]
            if device is request.device:
                return self._latched_pose(latch)
        found = stage.assembly.at(request.instant_ns, latch)
        if found is None:
            return None
        pose = stage.pipeline.pose_at(found.counts, stage.devices.temperature_c)
        pose = replace(pose, doubts_counts=found.doubts_counts)
        return stage.skew.marked(stage.pipeline.model, pose, found.doubts_counts)

    def _latched_pose(self, latch: LatchedCounts) -> LatchedPose | None:
        stage = self._stage
        if stage.devices.unfit is not None:
            return None
        return stage.pipeline.latched_pose(latch, stage.devices.temperature_c)

    def _outcome(
        self, request: Request, pose: LatchedPose | None
    ) -> Point | CaptureRefusedError:
        """The point that was captured, or why none was."""
        stage = self._stage
        if pose is None or request.trigger is None:
            self._capture.refused += 1
            return self._refused(*self._lack(request))
        point = self._capture.take(
            stage.pipeline.model,
            pose,
            request.trigger,
            stage.devices.temperature_c,
            self._covariance(request, pose),
        )
        if point is None:
            return self._refused(
                "the queue of points is full: the broker has not taken them",
                "wait until the broker is back, then take the point again",
            )
        taken_ns = stage.clock.monotonic_ns() - request.received_ns
        self._health.latencies["capture_to_publish"].add(taken_ns)
        return point

    def _covariance(self, request: Request, pose: LatchedPose) -> Covariance | None:
        stage, jitter_ns = self._stage, 0
        device = request.device
        if device is not None and pose.doubts_counts is not None and device.identity:
            jitter_ns = device.identity.jitter_ns
        speeds_rad_s = stage.path.speeds_rad_s(pose.sample_time_ns, pose.angles_rad)
        return stage.uncertainty.covariance(
            stage.pipeline.model,
            Reading(pose.block, speeds_rad_s, pose.doubts_counts, jitter_ns),
        )

    def _lack(self, request: Request) -> tuple[str, str]:
        """Why there is no pose, and what to do."""
        unfit = self._stage.devices.unfit
        if unfit is not None:
            text = f"{unfit.section.id} does not fit the arm file"
            return text, "see the event device.mismatch"
        lack = self._stage.assembly.lack(request.instant_ns, request.latch)
        text = f"the joints cannot be told at the instant of the point: {lack}"
        return text, "see the device's events, then take the point again"

    def _refused(self, text: str, remedy: str) -> CaptureRefusedError:
        self._events.report(
            "error", "capture.refused", text, source="capture", remedy=remedy
        )
        return CaptureRefusedError(text, remedy)

    def _tell_edge(
        self, device: Device, latch: LatchedCounts, trigger: Trigger | None
    ) -> None:
        if trigger is not None:
            self._events.report(
                "info",
                f"{trigger}.{'pressed' if latch.active else 'released'}",
                f"{trigger} {'on' if latch.active else 'off'}",
                source=f"{device.section.id}/{latch.input}",
                distinct=True,
            )


def _tell(answer: Answer, outcome: Point | CaptureRefusedError) -> None:
    if isinstance(outcome, Point):
        answer.set_result(outcome)
    else:
        answer.set_exception(outcome)
