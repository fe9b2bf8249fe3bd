"""Decimation by distance: a point each time the probe has moved so far."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.filters.point_filter import (
    PointFilter,
    check_positive,
)
from traverse.kinematics.filters.points import PointBlock

FIRST_LOOK, LONGEST_LOOK = 32, 4096


@dataclass(slots=True)
class Distance(PointFilter):
    """The first point, then each that is one spacing away from the last that passed.

    Straight distances and not lengths of the path: at rest the noise of many samples
    makes a long path that leads nowhere.

    Attributes:
        spacing_mm: from one point that passes to the next.
    """

    kind: ClassVar[str] = "distance"
    spacing_mm: float
    _last_mm: Floats | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        check_positive(self.spacing_mm, "spacing_mm")

    def apply(self, block: PointBlock) -> PointBlock:
        """The points of a block that pass."""
        points_mm, limit = block.xyz_mm, self.spacing_mm**2
        kept: list[int] = []
        row, last_mm = 0, self._last_mm
        if last_mm is None:
            row = int(np.append(np.isfinite(points_mm).all(axis=1), True).argmax())
        while row < len(points_mm):
            if last_mm is not None:
                row += first_beyond(points_mm[row:], last_mm, limit)
            if row < len(points_mm):
                kept.append(row)
                last_mm = points_mm[row].copy()
        self._last_mm = last_mm
        return block.rows(np.array(kept, dtype=np.intp))

    def restart(self) -> None:
        """Forget all points so far."""
        self._last_mm = None


def first_beyond(points_mm: Floats, centre_mm: Floats, limit_mm2: float) -> int:
    """Row of the first of points (n, 3) whose squared distance reaches a limit.

    It looks at few points first and at more and more, since the next is often near.

    Returns:
        The row; n if there is none.
    """
    row, look = 0, FIRST_LOOK
    while row < len(points_mm):
        away_mm = points_mm[row : row + look] - centre_mm
        far: Booleans = np.einsum("ij,ij->i", away_mm, away_mm) >= limit_mm2
        found = int(far.argmax())
        if far[found]:
            return row + found
        row, look = row + look, min(2 * look, LONGEST_LOOK)
    return len(points_mm)
