"""Pedals and buttons in packets or lines: levels become edges, once each.

A packet may have no check sum, so a changed level is accepted when the next shows it
too; the edge has counts and time of the first. In a report of motion a packet with
unchanged counts was caused by the pedal, and needs no confirmation.
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
    """Debounced levels of all pedals."""

    def __init__(self, debounce_ns: int, n_inputs: int) -> None:
        self._debounce_ns = debounce_ns
        self._n_inputs = n_inputs
        self._levels = 0
        self._first: dict[int, PolledSample] = {}
        self._until_ns: dict[int, int] = {}

    @property
    def unsettled(self) -> bool:
        """Whether a change waits for the next packet."""
        return bool(self._first)

    def begin(self, sample: PolledSample) -> None:
        """Take the levels of a sample; earlier changes are no edges."""
        self._levels = sample.inputs
        self._first.clear()
        self._until_ns.clear()

    def detect_edges(
        self, sample: PolledSample, *, certain: bool = False
    ) -> list[PedalEdge]:
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
