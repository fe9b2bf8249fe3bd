"""Filters that thin: one point for each spacing along the way or the surface.

`Distance` looks at the last point that passed. The others consider all points of a scan
so far: a surface that is swept twice is covered once. Their memory is bounded: beyond
`max_cells` the older half is dropped, and counted.
"""

import math
from dataclasses import dataclass, field
from itertools import product
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats, Indices, Integers
from traverse.kinematics.filters.point_filter import (
    PointBlock,
    PointFilter,
    check_positive,
)

FIRST_LOOK, LONGEST_LOOK = 32, 4096


@dataclass(slots=True)
class Distance(PointFilter):
    """Points one spacing away from the last that passed.

    Straight distances, not lengths of the path: at rest the noise of many samples makes
    a long path.
    """

    kind: ClassVar[str] = "distance"
    spacing_mm: float
    _last_mm: Floats | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        check_positive(self.spacing_mm, "spacing_mm")

    def apply(self, block: PointBlock) -> PointBlock:
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
        self._last_mm = None


def first_beyond(points_mm: Floats, centre_mm: Floats, limit_mm2: float) -> int:
    """Find the first of points (n, 3) whose squared distance reaches a limit.

    It looks at few points first and at more and more, since the next is often near.

    Returns:
        The row; n if there is none.
    """
    row, look = 0, FIRST_LOOK
    while row < len(points_mm):
        away_mm = points_mm[row : row + look] - centre_mm
        far: Booleans = np.einsum("ij,ij->i", away_mm, away_mm) >= limit_mm2
        offset = int(far.argmax())
        if far[offset]:
            return row + offset
        row, look = row + look, min(2 * look, LONGEST_LOOK)
    return len(points_mm)


BITS = 21  # of a cell's number along one axis
WRAP = 1 << BITS
MAX_CELLS = 2_000_000


@dataclass(slots=True)
class _Thinning(PointFilter):
    spacing_mm: float
    max_cells: int = MAX_CELLS
    forgotten: int = field(default=0, init=False)
    # By the key of a cell, the point that passed there where that matters.
    _young: dict[int, tuple[float, ...]] = field(default_factory=dict, init=False)
    _old: dict[int, tuple[float, ...]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        check_positive(self.spacing_mm, "spacing_mm")
        check_positive(self.max_cells, "max_cells")

    def restart(self) -> None:
        self._young, self._old = {}, {}

    def _remember(self, key: int, point_mm: tuple[float, ...]) -> None:
        if len(self._young) >= -(-self.max_cells // 2):
            self.forgotten += len(self._old)
            self._old, self._young = self._young, {}
        self._young[key] = point_mm


@dataclass(slots=True)
class GridSpacing(_Thinning):
    """The first point in each cubic cell of a grid.

    Attributes:
        forgotten: dropped cells, which may be filled again.
    """

    kind: ClassVar[str] = "grid"

    def apply(self, block: PointBlock) -> PointBlock:
        rows, keys = _first_of_cells(block.xyz_mm, self.spacing_mm)
        kept = []
        for row, key in zip(rows.tolist(), keys.tolist(), strict=True):
            if key not in self._young and key not in self._old:
                kept.append(row)
                self._remember(key, ())
        return block.rows(np.array(kept, dtype=np.intp))


@dataclass(slots=True)
class BallSpacing(_Thinning):
    """Points at least one spacing away from every point that passed before.

    Cells have the edge spacing / sqrt(3), so that each holds at most one point that
    passed, and a neighbour within the spacing is at most two cells away.

    Attributes:
        forgotten: dropped points, which may be met again.
    """

    kind: ClassVar[str] = "spacing"

    def apply(self, block: PointBlock) -> PointBlock:
        placed = np.flatnonzero(np.isfinite(block.xyz_mm).all(axis=1))
        points_mm, limit = block.xyz_mm[placed], self.spacing_mm**2
        cells = _cells(points_mm, self.spacing_mm / math.sqrt(3.0))
        kept: list[int] = []
        row = 0
        while row < len(points_mm):
            blocking = self._blocking(points_mm[row], cells[row])
            if blocking is None:
                kept.append(row)
                blocking = points_mm[row]
                key = int(_keys(cells[row : row + 1])[0])
                self._remember(key, tuple(blocking.tolist()))
            # What follows is most often blocked by the same point: pass over it.
            row += first_beyond(points_mm[row:], blocking, limit)
        return block.rows(placed[kept])

    def _blocking(self, point_mm: Floats, cell: Integers) -> Floats | None:
        """Return a point that passed before and is too near, or None."""
        x, y, z = point_mm.tolist()
        limit = self.spacing_mm**2
        for key in _keys(cell + _AROUND).tolist():
            near = self._young.get(key)
            if near is None:
                near = self._old.get(key)
            if near is not None:
                dx, dy, dz = near[0] - x, near[1] - y, near[2] - z
                if dx * dx + dy * dy + dz * dz < limit:
                    return np.array(near)
        return None


_AROUND = np.array(
    sorted(product(range(-2, 3), repeat=3), key=lambda step: sum(map(abs, step))),
    dtype=np.int64,
)


def _cells(xyz_mm: Floats, edge_mm: float) -> Integers:
    """Return the cell (n, 3) of each point, arbitrary without a place."""
    scaled = np.floor(xyz_mm / edge_mm)
    return np.where(np.isfinite(scaled), scaled, 0.0).astype(np.int64)


def _keys(cells: Integers) -> Integers:
    """One number a cell (n,); cells 2^21 edges apart along an axis share theirs."""
    wrapped = cells & (WRAP - 1)
    keys: Integers = wrapped[:, 0] << 2 * BITS | wrapped[:, 1] << BITS | wrapped[:, 2]
    return keys


def _first_of_cells(xyz_mm: Floats, edge_mm: float) -> tuple[Indices, Integers]:
    """Rows, ascending, of the first point in each cell of a block, with its key."""
    placed = np.flatnonzero(np.isfinite(xyz_mm).all(axis=1))
    keys = _keys(_cells(xyz_mm[placed], edge_mm))
    _, first = np.unique(keys, return_index=True)
    first.sort()
    return placed[first], keys[first]
