"""The line below the delays of a device's readings.

A reading arrives after its latch: its time of arrival less the device's time of the
latch is a constant offset plus a delay that is never negative. Against the device's
time these differences lie on or above a straight line, whose slope is the error of the
device's rate and whose height the smallest delay. It is the edge of their lower convex
hull below the middle of the time (Moon, Skelly and Towsley, INFOCOM 1999), so that
delays of a busy host do not move it, at any rate.

Strategy: the line is as well known as it is touched. Readings are collected in bins of
a quarter second; with usual delays nearly every bin has a reading near the line. Each
third of the time must have touched it, since the slope rests on both ends and a bend
shows in the middle. Of windows of several lengths the longest is used whose bound is
nearly the smallest: a long one averages delays that vary, a short one follows a rate
that drifts.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

Point = tuple[float, float]
"""Device's time since an origin [ns], and time of arrival less that [ns]."""

MAX_RATE_ERROR = 0.025  # beyond this it is not the clock that was stated
BINS = 96  # 24 s: long against jitter, short against temperature
WINDOWS = (6, 12, 24, 48, 96)  # in bins
LEAST_BINS, KNOWN_BINS = 6, 12
# The line rests on two of the smallest delays. How much smaller the smallest possible
# one is follows from the second smallest of each third (times 6, by trial with even,
# exponential and rarely small delays), and from what three bins in four do not exceed,
# which is what a counter that loses ticks now and then leaves open.
TOUCH_MARGIN, USUAL_MARGIN, USUAL_SHARE = 6.0, 1.3, 0.75
NEARLY_BEST = 2.0
LEAST_BOUND_NS = 30_000.0  # the host reads its own clock no better
SLOPE_CHANGE = 2e-3  # corners of a bin's hull beyond it will never carry the line


@dataclass(frozen=True, slots=True)
class FloorLine:
    """A line below the delays.

    Attributes:
        slope: of the host's time over the device's, less 1.
        bound_ns: distance to the smallest delay at its end; infinite with too few
            readings.
        span_ns: duration of the bins below which it lies.
    """

    slope: float
    height_ns: float
    bound_ns: float
    span_ns: float

    def at_ns(self, time_ns: float) -> float:
        return self.height_ns + self.slope * time_ns


class DelayFloor:
    """Collects readings, and fits the line below them."""

    def __init__(self, bin_ns: float) -> None:
        self._bin_ns = bin_ns
        self.reset()

    def reset(self) -> None:
        self._bins: deque[list[Point]] = deque(maxlen=BINS)
        self._slope: float | None = None
        self._hull: list[Point] = []
        self._ends_ns = self._bin_ns

    @property
    def n_bins(self) -> int:
        return len(self._bins)

    def add(self, time_ns: float, offset_ns: float) -> bool:
        """Add a reading; True if it begins a new bin, so that the line is new."""
        hull, is_new = self._hull, False
        if time_ns >= self._ends_ns:
            is_new = bool(hull)
            if hull:
                self._bins.append(self._pruned(hull))
            self._hull = hull = []
            self._ends_ns = (time_ns // self._bin_ns + 1.0) * self._bin_ns
        if hull and time_ns <= hull[-1][0]:
            if time_ns < hull[-1][0] or offset_ns >= hull[-1][1]:
                return is_new  # a late edge of a button; or the same tick, later
            hull.pop()
        _push(hull, (time_ns, offset_ns))
        return is_new

    def lines(self) -> tuple[FloorLine, Sequence[FloorLine]]:
        """Return the line of the best window, and those of all."""
        bins = list(self._bins)
        lengths = [n for n in WINDOWS if n < len(bins)]
        lines = [
            _line_below(bins[-n:], n * self._bin_ns) for n in (*lengths, len(bins))
        ]
        most_ns = NEARLY_BEST * min(line.bound_ns for line in lines)
        best = [line for line in lines if line.bound_ns <= most_ns][-1]
        if len(bins) >= KNOWN_BINS:
            self._slope = best.slope
        return best, lines

    def _pruned(self, hull: list[Point]) -> list[Point]:
        """Drop corners of a bin that no line of nearly the present slope can touch."""
        if self._slope is None or len(hull) < 2:
            return hull
        first = last = 0
        low, high = self._slope - SLOPE_CHANGE, self._slope + SLOPE_CHANGE
        for k in range(1, len(hull)):
            (t0, y0), (t1, y1) = hull[k - 1], hull[k]
            slope = (y1 - y0) / (t1 - t0)
            if slope < low:
                first = k
            if slope <= high:
                last = k
        return hull[first : max(first, last) + 1]


def _line_below(bins: list[list[Point]], span_ns: float) -> FloorLine:
    hull: list[Point] = []
    for points in bins:
        for point in points:
            _push(hull, point)
    slope = _slope_below(hull)
    height_ns = min(y - slope * t for t, y in hull)
    if len(bins) < LEAST_BINS:
        return FloorLine(slope, height_ns, float("inf"), span_ns)
    floors = [min(y - slope * t for t, y in points) - height_ns for points in bins]
    third = len(floors) // 3
    parts = floors[:third], floors[third:-third], floors[-third:]
    touch_ns = max(sorted(part)[1] for part in parts)
    usual_ns = sorted(floors)[int(USUAL_SHARE * len(floors))]
    bound_ns = max(TOUCH_MARGIN * touch_ns, USUAL_MARGIN * usual_ns) + LEAST_BOUND_NS
    return FloorLine(slope, height_ns, bound_ns, span_ns)


def _slope_below(hull: list[Point]) -> float:
    """Return the slope of the edge below the middle of the time."""
    if len(hull) < 2:
        return 0.0
    middle = (hull[0][0] + hull[-1][0]) / 2.0
    k = next(k for k in range(1, len(hull)) if hull[k][0] >= middle)
    (t0, y0), (t1, y1) = hull[k - 1], hull[k]
    return min(MAX_RATE_ERROR, max(-MAX_RATE_ERROR, (y1 - y0) / (t1 - t0)))


def _push(hull: list[Point], point: Point) -> None:
    """Add a later point to a lower convex hull."""
    t, y = point
    while len(hull) > 1:
        (t0, y0), (t1, y1) = hull[-2], hull[-1]
        if (y1 - y0) * (t - t0) < (y - y0) * (t1 - t0):
            break
        hull.pop()
    hull.append(point)
