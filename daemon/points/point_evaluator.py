"""From a request to what its point is made of: seen, averaged, compensated."""

from dataclasses import replace

from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.points.averaging import Average, AverageLimits
from traverse.daemon.points.capture import Measured
from traverse.daemon.points.compensation import RetractDetector, Tip, without_direction
from traverse.daemon.points.point_events import PointEventReporter
from traverse.daemon.points.pose_evaluator import ArmSight, Stage
from traverse.daemon.points.request_queue import Request
from traverse.daemon.pose.poses import PoseBlock
from traverse.kinematics.probing.compensation import DirectionError


class PointEvaluator:
    """Follows the stream for all requests that need more than their instant.

    Args:
        stage: what points are made with.
        settings: of the configuration.
        events: where it is told that a direction is not known.

    Attributes:
        tip: compensates for the ball.
    """

    def __init__(
        self, stage: Stage, settings: CaptureSection, events: PointEventReporter
    ) -> None:
        self._stage = stage
        self._sight = ArmSight(stage)
        self.tip = Tip(settings, stage.path)
        self._events = events
        self._dwell_ns = int(settings.average_s * 1e9)
        self._limits = AverageLimits(
            settings.average_speed_mm_s, settings.average_spread_mm
        )
        self._averages: list[Average] = []
        self._pulls: list[RetractDetector] = []

    def follow(self, poses: PoseBlock) -> None:
        """Go on by a block of the arm's stream."""
        for average in self._averages:
            average.add(poses)
        for pull in self._pulls:
            pull.add(poses)

    def look(self, request: Request) -> None:
        """Find out what can be seen of the arm at the instant of a request."""
        if request.average is not None:
            return
        seen = request.seen
        if seen is None:
            request.seen = seen = self._sight.at(request)
            if seen is None:
                return
            self._watch(request, seen.pose.sample_time_ns, seen)
        # An edge may overtake samples from before it.
        time_ns = seen.pose.sample_time_ns
        if not self.tip.needs_trajectory or self._stage.path.covers(time_ns):
            before_mm = self.tip.before(time_ns, seen.pose.xyz_mm)
            if before_mm is not seen.before_mm:
                request.seen = replace(seen, before_mm=before_mm)
            request.is_evaluated = True

    def start_average(self, request: Request, average: Average | None = None) -> None:
        """Let samples be averaged from the instant of a request on.

        Args:
            request: it is told.
            average: what is wanted; None: as buttons do.
        """
        begin_ns, path = request.instant_ns, self._stage.path
        if average is None:
            average = Average(begin_ns, None, self._dwell_ns, self._limits)
        average.begin_speed_mm_s = path.speed_mm_s(begin_ns)
        for block in path.between(begin_ns, self._stage.clock.monotonic_ns()):
            average.add(block)
        request.average = average
        self._averages.append(average)
        # Its place is hardly known yet: good enough for a direction.
        here_mm = path.position_mm(begin_ns)
        if here_mm is not None:
            average.before_mm = self.tip.before(begin_ns, here_mm)

    def set_air_point(self, request: Request, *, is_last_chance: bool) -> bool:
        """Remember where the ball was at a press in the air; False while it waits.

        Raises:
            CaptureRefusedError: nobody knows where it was.
        """
        if request.seen is None:
            if is_last_chance:
                raise CaptureRefusedError(*self._sight.lack(request))
            return False
        self.tip.set_air_point(request.seen.pose.xyz_mm)
        return True

    def measured(
        self, request: Request, *, is_last_chance: bool, is_crowded: bool
    ) -> Measured | None:
        """What the point of a request is made of; None while that has to wait.

        Raises:
            CaptureRefusedError: nothing, for a reason.
        """
        average, seen = request.average, request.seen
        if average is not None:
            if request.mean is None:
                request.mean = self._mean(average, is_last_chance, is_crowded)
                if request.mean is not None:
                    self._watch(request, average.last_ns, request.mean)
            seen = request.mean
        elif seen is None and (
            is_last_chance or self._stage.devices.first_mismatched is not None
        ):
            raise CaptureRefusedError(*self._sight.lack(request))
        if seen is None:
            return None
        pull, stage = request.pull, self._stage
        if pull is not None and not is_crowded:
            now_ns = stage.clock.monotonic_ns()
            if not pull.is_over(stage.path, now_ns, stage.point_wait_ns):
                return None
        try:
            return self.tip.compensated(seen, pull)
        except DirectionError as error:
            self._events.without_direction(error)
            return without_direction(seen)

    def arm_changed(self) -> None:
        """The samples from now on are of another arm: they mix with none before."""
        for average in self._averages:
            average.is_mixed = average.is_mixed or average.n > 0

    def forget(self, request: Request) -> None:
        """A request has been dealt with."""
        if request.average is not None:
            self._averages.remove(request.average)
        if request.pull is not None:
            self._pulls.remove(request.pull)

    def _watch(self, request: Request, time_ns: int, measured: Measured) -> None:
        if request.pull is not None:
            self._pulls.remove(request.pull)
        request.pull = self.tip.pull(time_ns, measured.pose.xyz_mm)
        if request.pull is not None:
            self._pulls.append(request.pull)

    def _mean(
        self, average: Average, is_last_chance: bool, is_crowded: bool
    ) -> Measured | None:
        average.check_begin()
        if average.is_complete and average.n:
            average.check()
            return self._sight.mean(average)
        if is_crowded:
            raise CaptureRefusedError(
                "too many edges came while samples were averaged",
                "average while no button is pressed, or for a shorter time",
            )
        if is_last_chance or average.is_complete:
            now_ns = self._stage.clock.monotonic_ns()
            average.refuse_if_over_time(now_ns, self._stage.point_wait_ns)
        return None
