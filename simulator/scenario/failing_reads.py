"""A board whose read of an encoder fails now and then: it keeps the count before."""

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.simulator.scenario.faults import UnreadFault


class FailingReads:
    """Reads of one encoder on one board.

    Attributes:
        failed_s: of each read that failed, times of the script: of the last one before
            that did not, and its own.
    """

    def __init__(self, fault: UnreadFault, seed: int) -> None:
        self._fault = fault
        self._draw = np.random.default_rng([seed, fault.seed, fault.channel])
        self._last_s = self._good_s = -1.0
        self._kept = self._left = 0
        self._may_fail = True
        self.failed_s: list[tuple[float, float]] = []

    def spoil(self, script_s: Floats, counts: Integers) -> None:
        """Replace what was not read in counts (n, n_channels), in place."""
        column = counts[:, self._fault.channel]
        for row, time_s in enumerate(script_s.tolist()):
            if time_s > self._last_s:
                self._read(time_s, int(column[row]))
            if time_s == self._last_s:  # also once more for another channel
                column[row] = self._kept

    def _read(self, time_s: float, count: int) -> None:
        fault, self._last_s = self._fault, time_s
        if self._may_fail and self._draw.random() < fault.probability:
            self._left = int(self._draw.integers(1, fault.most + 1))
        if not self._left or self._good_s < 0.0 or not fault.lasts(time_s):
            self._left, self._good_s, self._kept = 0, time_s, count
            self._may_fail = True
            return
        self._left, self._may_fail = self._left - 1, False
        self.failed_s.append((self._good_s, time_s))
