"""Filters by the conditions of a point: the probe's speed, its quality."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.filters.point_filter import Selection
from traverse.kinematics.filters.points import PointBlock


@dataclass(slots=True)
class Speed(Selection):
    """Points where the probe moved neither faster nor slower than allowed.

    The speed at a point is the distance from the one before it over the time between
    them. The first point of a stream has no speed and does not pass.

    Attributes:
        max_mm_s, min_mm_s: the limits, included.
    """

    kind: ClassVar[str] = "speed"
    max_mm_s: float = math.inf
    min_mm_s: float = 0.0
    _before: tuple[int, Floats] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_mm_s <= self.max_mm_s:
            raise ValueError(
                f"min_mm_s {self.min_mm_s:g} and max_mm_s {self.max_mm_s:g}: expected "
                "0 <= min_mm_s <= max_mm_s"
            )

    def keeps(self, block: PointBlock) -> Booleans:
        """Which points pass, (n,)."""
        if not len(block):
            return np.zeros(0, dtype=np.bool_)
        first = (block.time_ns[0], np.full(3, np.nan))
        time_ns, xyz_mm = self._before or first
        way_mm = np.diff(block.xyz_mm, axis=0, prepend=xyz_mm[np.newaxis])
        step_s = np.diff(block.time_ns, prepend=time_ns) * 1e-9
        self._before = int(block.time_ns[-1]), block.xyz_mm[-1].copy()
        # Compared as products: two samples of one instant have no quotient.
        length_mm = np.sqrt(np.einsum("ij,ij->i", way_mm, way_mm))
        slow = (
            np.isfinite(length_mm)
            if math.isinf(self.max_mm_s)
            else length_mm <= self.max_mm_s * step_s
        )
        kept: Booleans = slow & (length_mm >= self.min_mm_s * step_s)
        return kept

    def restart(self) -> None:
        """Forget all points so far."""
        self._before = None


@dataclass(frozen=True, slots=True)
class Unflagged(Selection):
    """Points without quality flags, apart from those that are allowed.

    Attributes:
        allowed: bits that do not matter.
    """

    kind: ClassVar[str] = "quality"
    allowed: int = 0

    def keeps(self, block: PointBlock) -> Booleans:
        """Which points pass, (n,)."""
        kept: Booleans = block.quality & ~np.uint32(self.allowed) == 0
        return kept
