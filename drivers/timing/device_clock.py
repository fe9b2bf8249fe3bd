"""Maps a device's ticks to the host's monotonic clock.

A read never happens before the latch, so ``received - ticks / rate`` is the true
offset plus a delay that is never negative. In each half second of device time the
smallest of these is kept, and a line is laid below the last of them, as near to them
all as it can be: its slope is the rate of the device's crystal, its height the smallest
delay. That line is an edge of their lower convex hull, the one below their mean time
(Moon, Skelly and Towsley, INFOCOM 1999), so that delays of a busy host do not move it.
What remains is the smallest delay itself, which no one-way measurement separates from
the offset. A request and its answer do: the delay of the answer is below the time of
both, so a clock is tied at once by a quick answer.
"""

from collections import deque
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Integers

WRAP = 1 << 32
BIN_S = 0.5
BINS = 64  # half a minute: long against jitter, short against temperature
BINS_FOR_SLOPE = 10  # five seconds: before, a busy host's delays look like a rate
MAX_RATE_ERROR = 1e-3  # a crystal is within 1e-4; beyond this it is not a clock
MAX_EARLY_NS = 20_000_000  # more than jitter: received so long before its latch
MAX_LAG_NS = 500_000  # 0.1 mm of a hand that moves at 200 mm/s


class DeviceClock:
    """Regression of device ticks on host time.

    Args:
        tick_rate_hz: nominal rate of the device's counter.
        wrap: where the counter returns to 0.

    Attributes:
        running: something has been learned, so that times are not idle talk.
        steps: how often the mapping had to start afresh, because a latch seemed to
            lie in the future (the device's counter or the host has jumped); not
            while it is uncertain.
    """

    def __init__(self, tick_rate_hz: float, wrap: int = WRAP) -> None:
        self._ns_per_tick = 1e9 / tick_rate_hz
        self._bin_ticks = max(1, round(BIN_S * tick_rate_hz))
        self._wrap = wrap
        self._last: int | None = None
        self.running = False
        self._bins: deque[tuple[int, float]] = deque(maxlen=BINS)
        self._bin_best: tuple[int, float] | None = None
        self._bin_index = 0
        self._height_ns = 0.0
        self.steps = 0
        self._tied = False
        self._restart(0, 0)

    @property
    def is_uncertain(self) -> bool:
        """Whether times may be late because the first reads were.

        Until it is tied, or two half seconds of the device agree on the smallest delay,
        half a second of the host has passed, and it has followed what it learned: a
        host that stood still reads all of a while at once, a busy one all of it late.
        """
        return not self._tied and (
            not self._is_confirmed
            or self._received_ns - self._anchor_ns < BIN_S * 1e9
            or self._jump_ns * self._share_left(self._last or 0) > MAX_LAG_NS
        )

    def tie(self) -> None:
        """Apply the current estimate at once: one delay is known to be small."""
        self._tied, self._jump_ns = True, 0.0

    def unwrap(self, ticks: NDArray[np.uint32]) -> Integers:
        """Ticks without wraps, (n,) int64, relative to the last ones."""
        unwrapped = ticks.astype(np.int64)
        if self._last is None:
            self._last = int(unwrapped[0])
        unwrapped[1:] -= unwrapped[:-1].copy()
        unwrapped[0] -= self._last % self._wrap
        # Steps of at most half a turn, forwards or back.
        half = self._wrap // 2
        unwrapped += half
        unwrapped %= self._wrap
        unwrapped -= half
        unwrapped[0] += self._last
        return np.cumsum(unwrapped, out=unwrapped)

    def unwrap_one(self, ticks: int) -> int:
        """`unwrap` for one tick count."""
        if self._last is None:
            self._last = ticks
        half = self._wrap // 2
        return self._last + (ticks - self._last + half) % self._wrap - half

    def update(self, ticks: int, received_ns: int) -> None:
        """Learn from a latch at ``ticks`` (unwrapped) read at ``received_ns``."""
        self._last, self._received_ns = ticks, received_ns
        if not self.running:
            self._restart(ticks, received_ns)
            self.running = True
        elif self.to_ns(ticks) - received_ns > MAX_EARLY_NS:
            # In the first half second only the first latch was late.
            self.steps += not self.is_uncertain
            self._restart(ticks, received_ns)
        elapsed = ticks - self._anchor_ticks
        offset_ns = received_ns - self._anchor_ns - elapsed * self._ns_per_tick
        index = elapsed // self._bin_ticks
        if index > self._bin_index:
            self._finish_bin(ticks)
            self._bin_index = index
            self._bin_best = None
        if self._bin_best is None or offset_ns < self._bin_best[1]:
            self._bin_best = (elapsed, offset_ns)
        if len(self._bins) < BINS_FOR_SLOPE and offset_ns < self._height_ns:
            # The first seconds use the smallest delay so far.
            self._enter(ticks, self._slope, offset_ns)

    def to_ns(self, ticks: int) -> int:
        """`to_ns_array` for one tick count, to the nanosecond."""
        elapsed = ticks - self._anchor_ticks
        elapsed_ns = elapsed * self._ns_per_tick
        correction_ns = (
            self._height_ns
            + self._slope * elapsed_ns
            + self._jump_ns * self._share_left(ticks)
        )
        return self._anchor_ns + round(elapsed_ns + correction_ns)

    def to_ns_array(self, ticks: Integers) -> Integers:
        """Host monotonic times, (n,) int64 [ns], of unwrapped ticks (n,)."""
        elapsed = ticks - self._anchor_ticks
        elapsed_ns = elapsed * self._ns_per_tick
        correction_ns = self._height_ns + self._slope * elapsed_ns
        if self._jump_ns and elapsed.min() < self._fit_ticks + self._bin_ticks:
            left = 1.0 - (elapsed - self._fit_ticks) / self._bin_ticks
            correction_ns += self._jump_ns * np.minimum(1.0, np.maximum(0.0, left))
        return self._anchor_ns + np.rint(elapsed_ns + correction_ns).astype(np.int64)

    def _share_left(self, ticks: int) -> float:
        """Of the way to the present line, at a time."""
        passed = ticks - self._anchor_ticks - self._fit_ticks
        return min(1.0, max(0.0, 1.0 - passed / self._bin_ticks))

    def _restart(self, ticks: int, received_ns: int) -> None:
        self._anchor_ticks = ticks
        self._anchor_ns = self._received_ns = received_ns
        self._tied = self._is_confirmed = False
        self._bins.clear()
        self._bin_index = 0
        self._bin_best = None
        self._slope = 0.0
        self._height_ns = 0.0
        self._fit_ticks = 0
        self._jump_ns = 0.0

    def _finish_bin(self, ticks: int) -> None:
        if self._bin_best is not None:
            self._bins.append(self._bin_best)
        at, offsets_ns = np.array(self._bins, dtype=np.float64).T
        if len(self._bins) < BINS_FOR_SLOPE:
            # No crystal drifts like the delays of a host that stands still for a bin.
            drift_ns = MAX_RATE_ERROR * self._ns_per_tick * (at[-1] - at)
            order = np.argsort(offsets_ns + drift_ns)
            slope, height_ns = 0.0, float((offsets_ns + drift_ns)[order[0]])
            # Where all of a bin is late, another one is not late by as much.
            apart_ns = np.abs(np.diff(offsets_ns[order[:2]])) + drift_ns[order[0]]
            self._is_confirmed = bool((apart_ns < MAX_LAG_NS).any())
        else:
            elapsed_ns = at * self._ns_per_tick
            self._is_confirmed = True
            slope = _slope_below(elapsed_ns.tolist(), offsets_ns.tolist())
            slope = min(MAX_RATE_ERROR, max(-MAX_RATE_ERROR, slope))
            height_ns = float(np.min(offsets_ns - slope * elapsed_ns))
        self._enter(ticks, slope, height_ns)

    def _enter(self, ticks: int, slope: float, height_ns: float) -> None:
        """Go over to a new line gradually, so that times never run backwards."""
        before_ns = self.to_ns(ticks)
        self._slope, self._height_ns, self._jump_ns = slope, height_ns, 0.0
        self._fit_ticks = ticks - self._anchor_ticks
        self._jump_ns = float(before_ns - self.to_ns(ticks))


def _slope_below(times: list[float], offsets: list[float]) -> float:
    """Slope of the lower convex hull's edge below the mean time; times rise."""
    hull: list[tuple[float, float]] = []
    for t, y in zip(times, offsets, strict=True):
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], (t, y)):
            hull.pop()
        hull.append((t, y))
    mean = sum(times) / len(times)
    (t0, y0), (t1, y1) = next(
        (left, right) for left, right in pairwise(hull) if right[0] >= mean
    )
    return (y1 - y0) / (t1 - t0)


def _turns_down(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]
) -> bool:
    """Whether b lies on or above the line from a to c."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
