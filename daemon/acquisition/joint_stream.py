"""Bounded buffer of one device's readings, interpolated at any instant."""

from collections import deque
from dataclasses import InitVar, dataclass

import numpy as np

from traverse.arrays import Booleans, Indices, Integers
from traverse.daemon.acquisition.interpolation import (
    EncoderReadings,
    Interpolated,
    InterpolationLimits,
    combined,
    exact,
    interpolate,
)
from traverse.daemon.readings.stops import GAP_NS, STEP_NS, Series
from traverse.drivers.base.values import (
    NOT_READ,
    CountSamples,
    LatchedCounts,
    are_valid,
)

KEPT_NS = 5_000_000_000  # an edge that is older finds nothing to interpolate
MAX_READINGS = 100_000
CLOCK_RESET_NS = 10_000_000  # beyond, the device's clock has begun afresh
NEVER_NS, LONG_AGO_NS = 2**62, -(2**62)


class ReadingBuffer:
    """Latest readings of the encoders on one device, over all turns.

    Args:
        channels: of the device that are joints, (n_joints,).
        wraps_counts: where each wraps to 0, (n_joints,): one turn or several.
    """

    def __init__(self, channels: Indices, wraps_counts: Integers) -> None:
        self._channels = channels
        self.wraps_counts = wraps_counts
        self.reset()

    def reset(self) -> None:
        """Forget all readings, as after a loss of power."""
        n_joints = len(self._channels)
        self._blocks: deque[EncoderReadings] = deque()
        self._size = 0
        self._stream: int | None = None
        self._next_number = self._first_number = 0
        self._counts = np.zeros(n_joints, np.int64)
        self._times_ns = np.full(n_joints, LONG_AGO_NS)
        self._begin_ns = np.full(n_joints, NEVER_NS)
        self._reach_ns = np.full(n_joints, LONG_AGO_NS)

    @property
    def begin_ns(self) -> int:
        """Since when every encoder has been read; `NEVER_NS` if one has not."""
        if not self._blocks:
            return NEVER_NS
        return max(int(self._begin_ns.max()), int(self._blocks[0].times_ns[0].max()))

    @property
    def reach_ns(self) -> int:
        return int(self._reach_ns.min())

    def add(self, samples: CountSamples, bound_ns: int) -> None:
        """Append samples whose times are known within a bound, if not better."""
        times_ns = np.repeat(
            samples.sample_time_ns[:, np.newaxis], len(self._channels), axis=1
        )
        if samples.skew_ns is not None:
            times_ns += samples.skew_ns[:, self._channels]
        numbers = self._numbered(samples)
        rows = self._ordered(times_ns)
        if not rows.all():
            times_ns, numbers = times_ns[rows], numbers[rows]
            if not len(numbers):
                return
        status = samples.status[rows][:, self._channels]
        raw = samples.counts[rows][:, self._channels].astype(np.int64)
        counts = self._unwrapped(raw, times_ns, are_valid(status))
        self._times_ns = times_ns[-1]
        bounds_ns = np.full(times_ns.shape, bound_ns)
        if samples.skew_bound_ns is not None:
            stated_ns = samples.skew_bound_ns[rows][:, self._channels]
            bounds_ns = np.where(stated_ns, stated_ns, bounds_ns)
        self._blocks.append(
            EncoderReadings(times_ns, counts, status, numbers, bounds_ns)
        )
        self._size += len(numbers)
        oldest_ns = int(times_ns[-1].max()) - KEPT_NS
        while len(self._blocks) > 1 and (
            self._size > MAX_READINGS
            or int(self._blocks[0].times_ns[-1].max()) < oldest_ns
        ):
            self._size -= len(self._blocks.popleft().numbers)

    def readings_around(self, instant_ns: int, back_ns: int) -> list[EncoderReadings]:
        """Return each joint's readings, from ``back_ns`` before an instant on."""
        chosen: list[EncoderReadings] = []
        for block in reversed(self._blocks):
            chosen.append(block)
            if int(block.times_ns[0].max()) < instant_ns - back_ns:
                break
        chosen.reverse()
        times_ns, counts, status, numbers, bounds_ns = map(
            np.concatenate, zip(*chosen, strict=True)
        )
        return [
            EncoderReadings(
                times_ns[:, k], counts[:, k], status[:, k], numbers, bounds_ns[:, k]
            )
            for k in range(len(self._channels))
        ]

    def between(self, begin_ns: int, end_ns: int) -> EncoderReadings | None:
        """Return readings (n, n_joints) of a time, ends included; None without any."""
        chosen: list[EncoderReadings] = []
        for block in reversed(self._blocks):
            if int(block.times_ns[-1].max()) < begin_ns:
                break
            chosen.append(block)
        if not chosen:
            return None
        chosen.reverse()
        times_ns, counts, status, numbers, bounds_ns = map(
            np.concatenate, zip(*chosen, strict=True)
        )
        rows = ((times_ns >= begin_ns) & (times_ns <= end_ns)).all(axis=1)
        if not rows.any():
            return None
        return EncoderReadings(
            times_ns[rows], counts[rows], status[rows], numbers[rows], bounds_ns[rows]
        )

    def _numbered(self, samples: CountSamples) -> Integers:
        if samples.stream != self._stream:
            self._stream, self._first_number = samples.stream, self._next_number
        numbers = samples.seq + self._first_number
        self._next_number = int(numbers[-1]) + 1
        return numbers

    def _ordered(self, times_ns: Integers) -> Booleans:
        """Return which rows are later than all before them."""
        if int((times_ns[0] - self._times_ns).min()) < -CLOCK_RESET_NS:
            self._blocks.clear()
            self._size = 0
            self._times_ns = np.full(len(self._channels), LONG_AGO_NS)
            self._reach_ns = self._times_ns.copy()
        before = np.concatenate([self._times_ns[np.newaxis], times_ns[:-1]])
        running_ns = np.maximum.accumulate(before, axis=0)
        return np.asarray((times_ns > running_ns).all(axis=1))

    def _unwrapped(
        self, raw: Integers, times_ns: Integers, valid: Booleans
    ) -> Integers:
        """Unwrap counts; an invalid one repeats the last valid one."""
        rows = np.where(valid, np.arange(len(raw))[:, np.newaxis], -1)
        latest = np.maximum.accumulate(rows, axis=0)
        known = np.where(
            latest >= 0, np.take_along_axis(raw, np.maximum(latest, 0), 0), self._counts
        )
        steps = np.diff(known, axis=0, prepend=self._counts[np.newaxis])
        wraps = self.wraps_counts
        half = wraps // 2
        counts = self._counts + np.cumsum((steps + half) % wraps - half, axis=0)
        self._counts = counts[-1]
        for k in np.flatnonzero(latest[-1] >= 0).tolist():
            self._reach_ns[k] = times_ns[latest[-1, k], k]
            if self._begin_ns[k] == NEVER_NS:
                self._begin_ns[k] = times_ns[int(valid[:, k].argmax()), k]
        return counts


MAX_GAP_PERIODS = 3  # readings further apart than so many periods have lost others


@dataclass(eq=False)
class JointStream:
    """Interpolates the joints on one device.

    Args:
        joints: of the arm, (k,).
        channels: of the device, (k,).
        wraps_counts: where each wraps to 0, (k,).
        wait_ns: longest wait for readings.

    Attributes:
        period_ns: of its stream; 0 if unknown.
        stated_jitter_ns: error of the instants by the driver's constant statement.
        time_bound_ns: error of the instants by the present state of the clock.
        is_alone: it has all joints of the arm.
        lost: no further reading is awaited.
    """

    joints: Indices
    channels: Indices
    wraps_counts: InitVar[Integers]
    wait_ns: int
    is_alone: bool = False

    def __post_init__(self, wraps_counts: Integers) -> None:
        self.history = ReadingBuffer(self.channels, wraps_counts)
        self.period_ns = 0
        self.stated_jitter_ns = self.time_bound_ns = 0
        self._bounds_ns: deque[tuple[int, int]] = deque()  # end of a block; its bound
        self.lost = False

    def record(self, samples: CountSamples) -> None:
        bound_ns = samples.time_bound_ns or self.stated_jitter_ns
        end_ns, bounds_ns = int(samples.sample_time_ns[-1]), self._bounds_ns
        bounds_ns.append((end_ns, bound_ns))
        while bounds_ns[0][0] < end_ns - KEPT_NS:
            bounds_ns.popleft()
        # An instant lies between a reading of this block and one of the last.
        last_ns = bounds_ns[-2][1] if len(bounds_ns) > 1 else bound_ns
        self.time_bound_ns = max(bound_ns, last_ns)
        is_common = self.is_alone and samples.skew_ns is None
        self.history.add(samples, 0 if is_common else bound_ns)

    def bound_at_ns(self, instant_ns: int) -> int:
        """How far the instants of readings around some instant may be off."""
        after_ns = self.time_bound_ns
        for end_ns, bound_ns in reversed(self._bounds_ns):
            if end_ns < instant_ns:
                return max(bound_ns, after_ns)
            after_ns = bound_ns
        return after_ns

    def latched(self, latch: LatchedCounts) -> Interpolated:
        counts = np.array([latch.counts], np.int64)[:, self.channels]
        status = np.array([latch.status], np.uint8)[:, self.channels]
        return exact(counts, status)

    def at_own_instants(self, block: CountSamples) -> Interpolated:
        status = block.status[:, self.channels]
        if block.skew_ns is None and are_valid(status).all():
            # What `at` would find, at once.
            return exact(block.counts[:, self.channels].astype(np.int64), status)
        return self.at(block.sample_time_ns)

    def at(self, instants_ns: Integers) -> Interpolated:
        """Interpolate at instants (n,)."""
        max_gap_ns = max(MAX_GAP_PERIODS * self.period_ns, self.wait_ns)
        limits = InterpolationLimits(max_gap_ns, 0 if self.lost else self.wait_ns)
        around = self.history.readings_around(int(instants_ns[0]), max_gap_ns)
        interpolated = [
            interpolate(readings, instants_ns, limits) for readings in around
        ]
        return combined(interpolated, np.stack)

    def series(self, begin_ns: int, end_ns: int) -> list[Series]:
        """Return the readings of a time, ends included, as seen from its end."""
        readings = self.history.between(begin_ns, end_ns)
        return [] if readings is None else series_of(self.joints, readings, end_ns)


def series_of(joints: Indices, readings: EncoderReadings, now_ns: int) -> list[Series]:
    """Return series of joints, of each by itself where readings are left out."""
    is_read = (readings.status & NOT_READ) == 0
    columns = np.arange(len(joints))
    series = []
    for group in [columns] if is_read.all() else np.split(columns, len(columns)):
        cells = np.ix_(is_read[:, group[0]], group)
        times_ns = readings.times_ns[cells]
        gaps = np.flatnonzero(np.diff(times_ns[:, 0]) > GAP_NS)
        begin = int(gaps[-1]) + 1 if len(gaps) else 0
        if not len(times_ns) - begin:
            continue
        passed_ns = max(int(times_ns[-1, 0] - times_ns[begin, 0]), 1)
        step = max(STEP_NS * (len(times_ns) - begin - 1) // passed_ns, 1)
        rows = np.arange(len(times_ns) - 1, begin - 1, -step)[::-1]
        series.append(
            Series(
                joints[group],
                (times_ns[rows] - now_ns) * 1e-9,
                readings.bounds_ns[cells][rows] * 1e-9,
                readings.counts[cells][rows].astype(np.float64),
            )
        )
    return series
