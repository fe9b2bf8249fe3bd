"""What is seen of the arm at one instant, or from it on."""

from dataclasses import KW_ONLY, dataclass

from traverse.daemon.points.averaging import SampleAverage
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.points.compensation import RetractDetector
from traverse.drivers.base.values import LatchedCounts


@dataclass(slots=True, eq=False)
class Observation:
    """One instant, and what `PointEvaluator` has found out about it so far.

    Attributes:
        instant_ns: host monotonic time of it.
        deadline_ns: until when readings after it may be waited for.
        latch: what a device latched at that instant.
        time_bound_ns: how far off the instant may be, by the clock that gave it.
        average: the samples of a mean.
        mean: of these samples, as soon as they are complete.
        pull: watches where the probe is pulled to.
        seen: the arm at the instant, as soon as it is known.
        is_complete: nothing more is to be seen of its instant.
    """

    instant_ns: int
    deadline_ns: int
    _: KW_ONLY
    latch: LatchedCounts | None = None
    time_bound_ns: int = 0
    average: SampleAverage | None = None
    mean: PointMeasurement | None = None
    pull: RetractDetector | None = None
    seen: PointMeasurement | None = None
    is_complete: bool = False

    def begin_anew(self) -> None:
        """Forget what was seen: it was of another arm."""
        self.seen = None
        self.is_complete = False
