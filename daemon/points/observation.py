"""Observation of the arm at one instant, or from it on."""

from dataclasses import KW_ONLY, dataclass

from traverse.daemon.points.averaging import SampleAverage
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.points.compensation import RetractDetector
from traverse.drivers.base.values import LatchedCounts


@dataclass(slots=True, eq=False)
class Observation:
    """An instant, and the arm's state found for it so far by `PointEvaluator`.

    Attributes:
        instant_ns: host monotonic time.
        deadline_ns: until when later readings may be awaited.
        movable_until_ns: until when a later instant may take the place of its own, if
            its joints are not known at one.
        latch: counts that a device latched at that instant.
        is_edge: whether it did so at an edge; else because it was asked.
        time_bound_ns: possible error of the instant, by the clock that gave it.
        average: samples of a mean.
        mean: their mean, as soon as they are complete.
        pull: watches in which direction the probe is pulled.
        seen: state of the arm at the instant, as soon as it is known.
        is_complete: no more is expected of the instant.
    """

    instant_ns: int
    deadline_ns: int
    _: KW_ONLY
    movable_until_ns: int = 0
    latch: LatchedCounts | None = None
    is_edge: bool = False
    time_bound_ns: int = 0
    average: SampleAverage | None = None
    mean: PointMeasurement | None = None
    pull: RetractDetector | None = None
    seen: PointMeasurement | None = None
    is_complete: bool = False

    def begin_anew(self) -> None:
        """Forget the state: it was of another arm."""
        self.seen = None
        self.is_complete = False
