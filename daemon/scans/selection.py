"""From the samples of a stream to the numbered points of a scan.

Buttons decide which samples count, the mode selects from them, and the configured
filters remove some. Points are numbered consecutively; each lost sample skips one
number, since it might have been a point. A gap in the numbers is therefore a real loss,
and bounds its size.
"""

from bisect import insort
from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np

from traverse.arrays import Booleans, Integers
from traverse.daemon.scans.plan import ScanPlan
from traverse.kinematics.filters import FilterChain, PointBlock
from traverse.protocol.messages import QualityFlag

MAX_EDGES = 256  # of one button; older ones are dropped
ButtonKey = tuple[str, int]


class ButtonGate:
    """Intervals in which buttons were held."""

    def __init__(self) -> None:
        self._edges: dict[ButtonKey, deque[tuple[int, bool]]] = {}

    def edge(self, button: ButtonKey, time_ns: int, held: bool) -> None:
        """Take a button's edge at a host monotonic time."""
        edges = self._edges.setdefault(button, deque())
        edge = (time_ns, held)
        if not edges or edges[-1] <= edge:  # nearly always
            edges.append(edge)
        else:
            insort(edges, edge)
        if len(edges) > MAX_EDGES:
            edges.popleft()

    def held(self, times_ns: Integers) -> Booleans:
        """Return when, of times (n,) not decreasing, any button was held.

        The instant of a press is held, that of a release is not.
        """
        any_held = np.zeros(len(times_ns), np.bool_)
        for edges in self._edges.values():
            at_ns = np.array([time_ns for time_ns, _ in edges])
            levels = np.array([False, *(held for _, held in edges)])
            any_held |= levels[np.searchsorted(at_ns, times_ns, side="right")]
        return any_held


INTERPOLATED = np.uint32(QualityFlag.INTERPOLATED)


class ScanSelection:
    """Selects the points of a scan, block after block.

    Args:
        gate: intervals in which buttons were held; None: all samples count.

    Attributes:
        next_number: of the next point, if nothing is lost before it.
    """

    def __init__(
        self, plan: ScanPlan, chain: FilterChain, gate: ButtonGate | None
    ) -> None:
        self._mode = plan.selection()
        self._chain = chain
        self._gate = gate
        self._interpolates = plan.mode == "planes" or chain.interpolates
        self._last: tuple[int, int] | None = None
        self._was_held = False
        self._points = 0
        self._lost = 0
        chain.restart()

    @property
    def next_number(self) -> int:
        return self._points + self._lost

    def points(self, instants: PointBlock) -> PointBlock:
        """Return the points of a nonempty block, ``seq`` being their numbers.

        ``seq`` of the instants counts from the scan's start.
        """
        lost_before = self._lost
        lost = self._lost_until(instants)
        if self._gate is None:
            selected = self._selected(instants)
        else:
            selected = self._held_only(instants, self._gate)
        first = self._points + lost_before
        numbers = np.arange(first, first + len(selected))
        if lost is not None:
            rows = np.searchsorted(instants.seq, selected.seq, side="right")
            numbers += np.append(0, lost)[rows]
            self._lost += int(lost[-1])
        self._points += len(selected)
        return replace(selected, seq=numbers)

    def break_interpolation(self) -> None:
        if self._mode is not None:
            self._mode.restart()
        for stage in self._chain.filters:
            if stage.interpolates:
                stage.restart()

    def _selected(self, instants: PointBlock) -> PointBlock:
        selected = instants if self._mode is None else self._mode.apply(instants)
        selected = self._chain.apply(selected)
        if self._interpolates and len(selected):
            selected = replace(selected, quality=selected.quality | INTERPOLATED)
        return selected

    def _held_only(self, instants: PointBlock, gate: ButtonGate) -> PointBlock:
        held = gate.held(instants.time_ns)
        turns = np.flatnonzero(np.diff(held)) + 1
        pieces = [instants.rows(slice(0, 0))]
        for start, end in pairwise([0, *turns.tolist(), len(held)]):
            if held[start]:
                if not self._was_held:
                    self.break_interpolation()
                pieces.append(self._selected(instants.rows(slice(start, end))))
            self._was_held = bool(held[start])
        return PointBlock.joined(pieces)

    def _lost_until(self, instants: PointBlock) -> Integers | None:
        """Return how many counting samples were lost before each, (n,)."""
        last, last_ns = self._last or (-1, int(instants.time_ns[0]))
        self._last = int(instants.seq[-1]), int(instants.time_ns[-1])
        if self._last[0] - last == len(instants):
            return None
        missing = np.diff(instants.seq, prepend=last) - 1
        if self._gate is not None:
            for row in np.flatnonzero(missing).tolist():
                before_ns = instants.time_ns[row - 1] if row else last_ns
                n = int(missing[row])
                ends_ns = float(before_ns), float(instants.time_ns[row])
                between_ns = np.linspace(*ends_ns, n + 2)[1:-1].astype(np.int64)
                missing[row] = np.count_nonzero(self._gate.held(between_ns))
        return np.asarray(np.cumsum(missing))
