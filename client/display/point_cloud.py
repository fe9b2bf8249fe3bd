"""A cloud of scanned points for display: thinned to a budget, never beyond."""

import numpy as np

from traverse.arrays import Floats

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
        self._places_mm = np.empty((min(budget, 1 << 14), 3), dtype=np.float32)
        self.version = 0
        self.clear()

    def clear(self) -> None:
        self.version += 1
        self.n_kept = 0
        self.n_seen = 0
        self.every = 1

    def add(self, xyz_mm: Floats) -> None:
        while len(xyz_mm):
            # Those whose number is a multiple of `every` are kept.
            first = -self.n_seen % self.every
            room = (self._budget - self.n_kept) * self.every
            part, xyz_mm = xyz_mm[: max(room, 1)], xyz_mm[max(room, 1) :]
            self._keep(part[first :: self.every])
            self.n_seen += len(part)
            if self.n_kept >= self._budget:
                self._halve()

    def bytes_from(self, start: int) -> bytes:
        """Return stored points from a number on: x, y, z as little-endian float32."""
        kept = self._places_mm[start : self.n_kept]
        return kept.astype("<f4", copy=False).tobytes()

    def _keep(self, places_mm: Floats) -> None:
        end = self.n_kept + len(places_mm)
        if end > len(self._places_mm):
            size = min(self._budget, max(end, 2 * len(self._places_mm)))
            grown = np.empty((max(size, end), 3), dtype=np.float32)
            grown[: self.n_kept] = self._places_mm[: self.n_kept]
            self._places_mm = grown
        self._places_mm[self.n_kept : end] = places_mm
        self.n_kept = end

    def _halve(self) -> None:
        half = self._places_mm[: self.n_kept : 2].copy()
        self._places_mm[: len(half)] = half
        self.n_kept = len(half)
        self.every *= 2
        self.version += 1
