"""Edges of devices that keep none themselves."""

from collections import Counter, deque
from collections.abc import Callable

from traverse.drivers.base.values import LatchedCounts, PolledSample
from traverse.plurals import counted

MAX_WAITING = 64


class PendingEdges:
    """Edges that wait for room; the oldest is dropped beyond the bound."""

    def __init__(
        self,
        device: str,
        put: Callable[[LatchedCounts], bool],
        fault: Callable[[str, str, str, int], None],
        counters: Counter[str],
    ) -> None:
        self._device, self._put, self._fault = device, put, fault
        self._counters = counters
        self._waiting: deque[LatchedCounts] = deque()
        self._token = self._lost = 0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, number: int, active: bool, sample: PolledSample) -> None:
        self._token += 1
        times_ns = sample.ticks, sample.received_ns, sample.time_ns
        latch = LatchedCounts(
            *(self._device, number, active, self._token, *times_ns),
            *(sample.counts, sample.status, sample.time_bound_ns),
        )
        self._waiting.append(latch)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._lost += 1

    def hand_over(self) -> None:
        """Deliver waiting edges as far as there is room, then report losses."""
        # In order of time; inputs settle one after the other, and not by their times.
        for latch in sorted(self._waiting, key=lambda waiting: waiting.sample_time_ns):
            if not self._put(latch):
                return
            self._waiting.remove(latch)
            self._counters["edges_received"] += 1
        if lost := self._lost:
            self._lost = 0
            self._fault(
                "edges_lost",
                f"{counted(lost, 'edge')} of {self._device} lost: there was no room",
                "the daemon is overloaded; repeat the last points",
                lost,
            )
