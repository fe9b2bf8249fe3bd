"""Pedals and buttons in packets or lines: levels become edges, once each.

A packet may have no check sum, so a changed level is accepted when the next shows it
too; the edge then has the counts and the time of the packet that showed it first. In a
report of motion a packet whose counts are those of before can only be there because of
the pedal: it needs no other.
"""

from dataclasses import dataclass

from traverse.drivers.base.values import PolledSample


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
