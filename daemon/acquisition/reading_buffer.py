"""The last readings of one device's encoders, over all turns; bounded."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.acquisition.interpolation import Integers, Readings, are_valid
from traverse.drivers.base.values import CountSamples

KEPT_NS = 5_000_000_000  # an edge that is older finds nothing to interpolate
MAX_READINGS = 100_000
CLOCK_RESET_NS = 10_000_000  # beyond, the device's clock has begun afresh
NEVER_NS, LONG_AGO_NS = 2**62, -(2**62)


class _Block:
    """Readings (n, n_joints) of one delivery."""

    __slots__ = ("counts", "numbers", "status", "times_ns")

    def __init__(
        self,
        times_ns: Integers,
        counts: Integers,
        status: NDArray[np.uint8],
        numbers: Integers,
    ) -> None:
        self.times_ns, self.counts = times_ns, counts
        self.status, self.numbers = status, numbers


class History:
    """Follows the encoders that one device reads for the arm.

    Args:
        channels: of the device that are joints, (n_joints,).
        counts_per_turn: of each, (n_joints,).

    Attributes:
        n_out_of_order: readings left out because their time was not after the
            last one's.
    """

    def __init__(self, channels: NDArray[np.intp], counts_per_turn: Integers) -> None:
        self._channels = channels
        self._turns = counts_per_turn
        self.n_out_of_order = 0
        self.forget()

    def forget(self) -> None:
        """Begin anew: the device has been without power."""
        n_joints = len(self._channels)
        self._blocks: deque[_Block] = deque()
        self._size = 0
        self._stream: int | None = None
        self._next_number = self._first_number = 0
        self._counts = np.zeros(n_joints, np.int64)
        self._times_ns = np.full(n_joints, LONG_AGO_NS)
        self._begin_ns = np.full(n_joints, NEVER_NS)
        self._reach_ns = np.full(n_joints, LONG_AGO_NS)

    @property
    def begin_ns(self) -> int:
        """Since when every encoder has been read; `NEVER_NS` while one has not."""
        if not self._blocks:
            return NEVER_NS
        return max(int(self._begin_ns.max()), int(self._blocks[0].times_ns[0].max()))

    @property
    def reach_ns(self) -> int:
        """Until when every encoder has been read."""
        return int(self._reach_ns.min())

    def add(self, samples: CountSamples) -> None:
        """Continue by a block of the device's samples."""
        times_ns = np.repeat(
            samples.sample_time_ns[:, np.newaxis], len(self._channels), axis=1
        )
        if samples.skew_ns is not None:
            times_ns += samples.skew_ns[:, self._channels]
        numbers = self._numbered(samples)
        rows = self._ordered(times_ns)
        if not rows.all():
            self.n_out_of_order += len(rows) - int(rows.sum())
            times_ns, numbers = times_ns[rows], numbers[rows]
            if not len(numbers):
                return
        status = samples.status[rows][:, self._channels]
        raw = samples.counts[rows][:, self._channels].astype(np.int64)
        counts = self._unwrapped(raw, times_ns, are_valid(status))
        self._times_ns = times_ns[-1]
        self._blocks.append(_Block(times_ns, counts, status, numbers))
        self._size += len(numbers)
        oldest_ns = int(times_ns[-1].max()) - KEPT_NS
        while len(self._blocks) > 1 and (
            self._size > MAX_READINGS
            or int(self._blocks[0].times_ns[-1].max()) < oldest_ns
        ):
            self._size -= len(self._blocks.popleft().numbers)

    def around(self, instant_ns: int, back_ns: int) -> list[Readings]:
        """For each joint its readings from some time before an instant to the last."""
        chosen: list[_Block] = []
        for block in reversed(self._blocks):
            chosen.append(block)
            if int(block.times_ns[0].max()) < instant_ns - back_ns:
                break
        chosen.reverse()
        times_ns = np.concatenate([block.times_ns for block in chosen])
        counts = np.concatenate([block.counts for block in chosen])
        status = np.concatenate([block.status for block in chosen])
        numbers = np.concatenate([block.numbers for block in chosen])
        return [
            Readings(times_ns[:, k], counts[:, k], status[:, k], numbers)
            for k in range(len(self._channels))
        ]

    def _numbered(self, samples: CountSamples) -> Integers:
        """Numbers that go on from stream to stream."""
        if samples.stream != self._stream:
            self._stream, self._first_number = samples.stream, self._next_number
        numbers = samples.seq + self._first_number
        self._next_number = int(numbers[-1]) + 1
        return numbers

    def _ordered(self, times_ns: Integers) -> NDArray[np.bool_]:
        """Which rows come after all before them."""
        if int((times_ns[0] - self._times_ns).min()) < -CLOCK_RESET_NS:
            self._blocks.clear()
            self._size = 0
            self._times_ns = np.full(len(self._channels), LONG_AGO_NS)
            self._reach_ns = self._times_ns.copy()
        before = np.concatenate([self._times_ns[np.newaxis], times_ns[:-1]])
        running_ns = np.maximum.accumulate(before, axis=0)
        return np.asarray((times_ns > running_ns).all(axis=1))

    def _unwrapped(
        self, raw: Integers, times_ns: Integers, valid: NDArray[np.bool_]
    ) -> Integers:
        """Counts over all turns; those that are not valid repeat the last that was."""
        rows = np.where(valid, np.arange(len(raw))[:, np.newaxis], -1)
        latest = np.maximum.accumulate(rows, axis=0)
        known = np.where(
            latest >= 0, np.take_along_axis(raw, np.maximum(latest, 0), 0), self._counts
        )
        steps = np.diff(known, axis=0, prepend=self._counts[np.newaxis])
        half = self._turns // 2
        counts = self._counts + np.cumsum((steps + half) % self._turns - half, axis=0)
        self._counts = counts[-1]
        for k in np.flatnonzero(latest[-1] >= 0).tolist():
            self._reach_ns[k] = times_ns[latest[-1, k], k]
            if self._begin_ns[k] == NEVER_NS:
                self._begin_ns[k] = times_ns[int(valid[:, k].argmax()), k]
        return counts
