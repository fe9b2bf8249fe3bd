"""Pedals and buttons in packets or lines: levels become edges, once each.

A packet may have no check sum, so a changed level is accepted when the next shows it
too; the edge then has the counts and the time of the packet that showed it first. In a
report of motion a packet whose counts are those of before can only be there because of
the pedal: it needs no other.
"""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

from traverse.drivers.base.values import LatchedCounts
from traverse.drivers.polling.sampling import PolledSample
from traverse.plurals import counted

MAX_WAITING = 64


@dataclass(frozen=True, slots=True)
class PedalEdge:
    """A pedal was pressed or released."""

    number: int
    down: bool
    first: PolledSample


class PedalDebouncer:
    """Confirmed levels of all pedals."""

    def __init__(self, debounce_ns: int, n_inputs: int) -> None:
        self._debounce_ns = debounce_ns
        self._n_inputs = n_inputs
        self._levels = 0
        self._first: dict[int, PolledSample] = {}
        self._until_ns: dict[int, int] = {}

    @property
    def unsettled(self) -> bool:
        """A change waits for the next packet."""
        return bool(self._first)

    def begin(self, sample: PolledSample) -> None:
        """Take the levels of a sample; what changed before it is no edge."""
        self._levels = sample.inputs
        self._first.clear()
        self._until_ns.clear()

    def detect_edges(
        self, sample: PolledSample, *, certain: bool = False
    ) -> list[PedalEdge]:
        """The edges that a packet confirms, or shows beyond doubt."""
        edges = []
        for number in range(self._n_inputs):
            bit = 1 << number
            if not (self._levels ^ sample.inputs) & bit:
                self._first.pop(number, None)
            elif number in self._first or certain:
                first = self._first.pop(number, sample)
                self._levels ^= bit
                self._until_ns[number] = first.time_ns + self._debounce_ns
                edges.append(PedalEdge(number, bool(sample.inputs & bit), first))
            elif sample.time_ns >= self._until_ns.get(number, sample.time_ns):
                self._first[number] = sample
        return edges


class PendingEdges:
    """Edges that wait until there is room for them; nobody else keeps them.

    Where too many wait the oldest is lost.
    """

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

    def add(self, number: int, active: bool, at: PolledSample) -> None:
        """Take an edge of input ``number``."""
        self._token += 1
        times_ns = at.ticks, at.received_ns, at.time_ns
        latch = LatchedCounts(
            self._device, number, active, self._token, *times_ns, at.counts, at.status
        )
        self._waiting.append(latch)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self._lost += 1

    def hand_over(self) -> None:
        """Deliver what waits as far as there is room, then report what was lost."""
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
