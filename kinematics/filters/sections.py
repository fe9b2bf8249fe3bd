"""Section planes: points where the path crosses a family of parallel planes."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats, Indices, Integers
from traverse.kinematics.filters.point_filter import (
    PointBlock,
    PointFilter,
    Vector,
    check_positive,
    unit,
)


@dataclass(slots=True)
class Sections(PointFilter):
    """Crossings of the planes normal . x = offset + k spacing, interpolated onto them.

    A path that rests on a plane crosses it with every sample's noise: the plane counts
    again once the path has been away from it by `clearance_mm`. Samples further apart
    than `max_gap_s` are not interpolated.

    Attributes:
        normal: of the planes, any length above 0.
        offset_mm: of one of them from the origin, along the normal.
        clearance_mm: see above; None: a tenth of the spacing.
    """

    kind: ClassVar[str] = "sections"
    interpolates: ClassVar[bool] = True
    normal: Vector
    spacing_mm: float
    offset_mm: float = 0.0
    clearance_mm: float | None = None
    max_gap_s: float = 0.1
    _before: PointBlock | None = field(default=None, init=False)
    _plane: int | None = field(default=None, init=False)
    _away: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        unit(self.normal, "normal")
        check_positive(self.spacing_mm, "spacing_mm")
        check_positive(self.max_gap_s, "max_gap_s")
        if self.clearance_mm is not None:
            check_positive(self.clearance_mm, "clearance_mm")

    def apply(self, block: PointBlock) -> PointBlock:
        if not len(block):
            return block
        path = block.after(self._before)
        self._before = path.rows(slice(len(path) - 1, None))
        heights_mm = path.xyz_mm @ unit(self.normal, "normal") - self.offset_mm
        heights = heights_mm / self.spacing_mm
        steps, planes = self._crossings(heights, path.time_ns)
        kept = self._first_ones(heights, steps, planes)
        steps, planes = steps[kept], planes[kept]
        shares = (planes - heights[steps]) / (heights[steps + 1] - heights[steps])
        return path.between(steps, np.clip(shares, 0.0, 1.0))

    def restart(self) -> None:
        self._before, self._plane, self._away = None, None, 0.0

    def _crossings(
        self, heights: Floats, time_ns: Integers
    ) -> tuple[Indices, Integers]:
        """Return steps (m,) of the path that cross planes, and the planes (m,)."""
        usable = np.isfinite(heights[:-1]) & np.isfinite(heights[1:])
        usable &= np.diff(time_ns) <= self.max_gap_s * 1e9
        below = np.floor(np.where(np.isfinite(heights), heights, 0.0)).astype(np.int64)
        n_crossed = np.where(usable, np.abs(np.diff(below)), 0)
        steps = np.repeat(np.arange(len(n_crossed)), n_crossed)
        starts = np.cumsum(n_crossed) - n_crossed
        within = np.arange(len(steps)) - starts[steps]
        upwards = below[steps + 1] > below[steps]
        planes = np.where(upwards, below[steps] + 1 + within, below[steps] - within)
        return steps, planes

    def _first_ones(
        self, heights: Floats, steps: Indices, planes: Integers
    ) -> list[int]:
        clearance = (self.clearance_mm or 0.1 * self.spacing_mm) / self.spacing_mm
        kept, done = [], 1
        for number, (step, plane) in enumerate(
            zip(steps.tolist(), planes.tolist(), strict=True)
        ):
            self._leave(heights[done : step + 1])
            done = max(done, step + 1)
            if plane != self._plane or self._away >= clearance:
                kept.append(number)
                self._plane, self._away = plane, 0.0
        self._leave(heights[done:])
        return kept

    def _leave(self, heights: Floats) -> None:
        """Update the distance from the last plane, in spacings."""
        known = heights[np.isfinite(heights)]
        if self._plane is not None and len(known):
            away = np.abs(known - self._plane)
            self._away = max(self._away, float(np.max(away, initial=0.0)))
