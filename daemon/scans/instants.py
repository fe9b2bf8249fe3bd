"""Instants of a scan that lie between the samples of its stream."""

import numpy as np

from traverse.arrays import Integers


class ScanInstants:
    """Instant k is ``begin + k / rate``, where ``begin`` is the stream's first sample.

    Instants between two samples of which one in between was lost are lost, too.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = 1e9 / rate_hz
        self._begin_ns = self._next = 0
        self._last: tuple[int, int, int] | None = None  # stream, number and time

    def until(
        self, stream: int, seq: Integers, times_ns: Integers
    ) -> tuple[Integers, Integers]:
        """Return numbers and times of the next instants, (n,), up to a block's end.

        ``stream``, ``seq`` and ``times_ns`` (m,) are those of the block's samples.
        """
        begin_ns = int(times_ns[0])
        if self._last is None:
            self._begin_ns = begin_ns
        elif self._last[0] == stream:
            seq = np.append(self._last[1], seq)
            times_ns = np.append(self._last[2], times_ns)
            begin_ns = int(times_ns[0])
        self._last = stream, int(seq[-1]), int(times_ns[-1])
        first = max(self._next, int((begin_ns - self._begin_ns) // self._period_ns))
        end = int((times_ns[-1] - self._begin_ns) // self._period_ns) + 2
        numbers = np.arange(first, end)
        passed_ns = np.rint(numbers * self._period_ns).astype(np.int64)
        instants_ns = self._begin_ns + passed_ns
        is_due = (instants_ns >= begin_ns) & (instants_ns <= times_ns[-1])
        numbers, instants_ns = numbers[is_due], instants_ns[is_due]
        if len(numbers):
            self._next = int(numbers[-1]) + 1
        after = np.searchsorted(times_ns, instants_ns, side="left")
        before = np.maximum(after - 1, 0)
        is_kept = (seq[after] - seq[before] <= 1) | (times_ns[after] == instants_ns)
        return numbers[is_kept], instants_ns[is_kept]
