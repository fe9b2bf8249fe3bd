"""While a button is held: the levels of buttons over time, by the edges' own time.

An edge is heard of later than the samples that followed it: a device waits for the
input to keep its level, and repeats what was lost on the line. Whoever asks does so
only of times for which no edge is expected any more.
"""

from bisect import insort
from collections import deque

import numpy as np
from numpy.typing import NDArray

MAX_EDGES = 256  # of one button; older ones are forgotten
Key = tuple[str, int]


class ButtonGate:
    """Remembers when which button was held."""

    def __init__(self) -> None:
        self._edges: dict[Key, deque[tuple[int, bool]]] = {}

    def edge(self, button: Key, time_ns: int, held: bool) -> None:
        """A button was pressed or released.

        Args:
            button: device and number of the input.
            time_ns: host monotonic.
            held: pressed.
        """
        edges = self._edges.setdefault(button, deque())
        edge = (time_ns, held)
        if not edges or edges[-1] <= edge:  # nearly always
            edges.append(edge)
        else:
            insort(edges, edge)
        if len(edges) > MAX_EDGES:
            edges.popleft()

    def held(self, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """At which times (n,), not decreasing, any button was held.

        The instant of a press is held, that of a release is not.
        """
        any_held = np.zeros(len(times_ns), np.bool_)
        for edges in self._edges.values():
            at_ns = np.array([time_ns for time_ns, _ in edges])
            levels = np.array([False, *(held for _, held in edges)])
            any_held |= levels[np.searchsorted(at_ns, times_ns, side="right")]
        return any_held
