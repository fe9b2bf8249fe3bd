"""Latencies of the last few thousand occurrences, as percentiles."""

import numpy as np

KEPT = 4096


class Latencies:
    """A bounded ring of durations."""

    def __init__(self) -> None:
        self._values_ns = np.zeros(KEPT, dtype=np.int64)
        self._n = 0

    def add(self, duration_ns: int) -> None:
        """Note one duration; the oldest is forgotten."""
        self._values_ns[self._n % KEPT] = duration_ns
        self._n += 1

    def figures_us(self) -> tuple[float, float, float, int] | None:
        """Median, 99th percentile and maximum [us] of those kept, and how many."""
        kept = min(self._n, KEPT)
        if not kept:
            return None
        values = self._values_ns[:kept] / 1000.0
        p50, p99 = np.percentile(values, [50, 99])
        return float(p50), float(p99), float(values.max()), kept

    def clear(self) -> None:
        """Begin again."""
        self._n = 0
