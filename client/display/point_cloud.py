"""A cloud of scanned points for display: thinned to a budget, never beyond."""

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.protocol.messages import REMARKS, Scan
from traverse.protocol.messages.later_doubt import LaterDoubt

BUDGET = 1_000_000


class Cloud:
    """Keeps every k-th point; k doubles when the budget is full.

    Args:
        budget: most points stored and drawn; even.

    Attributes:
        version: changes when earlier output is invalid.
        every: k.
    """

    def __init__(self, budget: int = BUDGET) -> None:
        self._budget = budget
        room = min(budget, 1 << 14)
        self._rows = np.empty((room, 4), dtype=np.float32)  # place and doubt
        self._times_ns = np.empty(room, dtype=np.int64)
        self.version = 0
        self.clear()

    def clear(self) -> None:
        self.version += 1
        self.n_kept = 0
        self.n_seen = 0
        self.every = 1

    def take(self, scan: Scan) -> None:
        """Add a block; its doubts are 1, else 0."""
        are_doubtful = (scan.quality.astype(np.int64) & ~REMARKS.value) != 0
        rows = np.column_stack([scan.xyz_mm, are_doubtful])
        self.add(rows, scan.time_ns + np.asarray(scan.dtime_ns, np.int64))

    def add(self, rows: Floats, times_ns: Integers) -> None:
        while len(rows):
            # Those whose number is a multiple of `every` are kept.
            first = -self.n_seen % self.every
            room = max((self._budget - self.n_kept) * self.every, 1)
            kept = slice(first, room, self.every)
            self._keep(rows[kept], times_ns[kept])
            self.n_seen += len(rows[:room])
            rows, times_ns = rows[room:], times_ns[room:]
            if self.n_kept >= self._budget:
                self._halve()

    def doubt(self, doubt: LaterDoubt) -> None:
        """Mark points that an event puts in doubt."""
        are_meant = doubt.concerns(self._times_ns[: self.n_kept])
        if are_meant.any():
            self._rows[: self.n_kept][are_meant, 3] = 1.0
            self.version += 1

    def bytes_from(self, start: int) -> bytes:
        """Return stored points from a number on: x, y, z, doubt as float32."""
        kept = self._rows[start : self.n_kept]
        return kept.astype("<f4", copy=False).tobytes()

    def _keep(self, rows: Floats, times_ns: Integers) -> None:
        end = self.n_kept + len(rows)
        if end > len(self._rows):
            size = max(end, min(self._budget, 2 * len(self._rows)))
            self._rows = np.resize(self._rows, (size, 4))
            self._times_ns = np.resize(self._times_ns, size)
        self._rows[self.n_kept : end] = rows
        self._times_ns[self.n_kept : end] = times_ns
        self.n_kept = end

    def _halve(self) -> None:
        half = (self.n_kept + 1) // 2
        self._rows[:half] = self._rows[: self.n_kept : 2].copy()
        self._times_ns[:half] = self._times_ns[: self.n_kept : 2].copy()
        self.n_kept = half
        self.every *= 2
        self.version += 1
