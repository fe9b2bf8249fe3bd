"""Latencies: percentiles of the latest, histogram of all."""

import contextlib
import gc
import time
from bisect import bisect_left
from collections.abc import Iterator
from operator import sub

import numpy as np

from traverse.protocol.messages.health import LATENCIES, LATENCY_BOUNDS_US, Latency

KEPT = 4096
BOUNDS_NS = [bound_us * 1000 for bound_us in LATENCY_BOUNDS_US]


class Latencies:
    """Bounded ring of durations, and a histogram.

    Attributes:
        total_counts: by bin since the start; `LATENCY_BOUNDS_US` are the upper
            bounds, the last bin has none.
        total_ns: sum of all durations since the start.
    """

    def __init__(self) -> None:
        self._values_ns = np.zeros(KEPT, dtype=np.int64)
        self._n = 0
        self._largest_ns = 0
        self.total_counts = [0] * (len(BOUNDS_NS) + 1)
        self.total_ns = 0
        self._told_counts = list(self.total_counts)

    def add(self, duration_ns: int) -> None:
        self._values_ns[self._n % KEPT] = duration_ns
        self._n += 1
        self._largest_ns = max(self._largest_ns, duration_ns)
        self.total_counts[bisect_left(BOUNDS_NS, duration_ns)] += 1
        self.total_ns += max(0, duration_ns)

    def figures(self) -> Latency | None:
        """Return the distribution since `clear`; None without data.

        Median and 99th percentile are of the latest 4096, interpolated linearly; other
        figures are of all.
        """
        # The garbage collector notes its durations in whatever thread it runs, also
        # between two lines of this: all is read once, and n is that of the histogram.
        before = self._told_counts
        histogram = tuple(map(sub, list(self.total_counts), before))
        if not self._n or not sum(histogram):
            return None
        values_us = self._values_ns[: min(self._n, KEPT)] / 1000.0
        p50_us, p99_us = np.percentile(values_us, [50, 99])
        return Latency(
            p50_us=float(p50_us),
            p99_us=float(p99_us),
            max_us=self._largest_ns / 1000.0,
            n=sum(histogram),
            histogram=histogram,
        )

    def clear(self) -> None:
        """Begin again, except for the totals."""
        self._n = self._largest_ns = 0
        self._told_counts = list(self.total_counts)


def latencies_by_name() -> dict[str, Latencies]:
    return {name: Latencies() for name in LATENCIES}


@contextlib.contextmanager
def timed_collections(latencies: Latencies) -> Iterator[None]:
    begun_ns = 0

    def on_phase(phase: str, _info: dict[str, int]) -> None:
        nonlocal begun_ns
        now_ns = time.monotonic_ns()
        if phase == "start":
            begun_ns = now_ns
        elif begun_ns:
            latencies.add(now_ns - begun_ns)
            begun_ns = 0

    gc.callbacks.append(on_phase)
    try:
        yield
    finally:
        gc.callbacks.remove(on_phase)
