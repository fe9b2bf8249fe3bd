"""Filters of single points: place, speed, quality."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.filters.point_filter import (
    PointBlock,
    Selection,
    Vector,
    check_positive,
    unit,
)


@dataclass(slots=True)
class Speed(Selection):
    """Points within limits of the probe's speed.

    The speed at a point is the distance from the one before it over the time between
    them. The first point of a stream does not pass.

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
        self._before = None


@dataclass(frozen=True, slots=True)
class Unflagged(Selection):
    """Points without quality flags, apart from allowed ones.

    Attributes:
        allowed: bits that do not matter.
    """

    kind: ClassVar[str] = "quality"
    allowed: int = 0

    def keeps(self, block: PointBlock) -> Booleans:
        kept: Booleans = block.quality & ~np.uint32(self.allowed) == 0
        return kept


@dataclass(frozen=True, slots=True)
class Box(Selection):
    """Points in a box along the axes of the arm's system, its surface included.

    Attributes:
        outside: invert.
    """

    kind: ClassVar[str] = "box"
    low_mm: Vector
    high_mm: Vector
    outside: bool = False

    def __post_init__(self) -> None:
        if not all(a <= b for a, b in zip(self.low_mm, self.high_mm, strict=True)):
            raise ValueError(
                f"low_mm {list(self.low_mm)} is not below high_mm "
                f"{list(self.high_mm)} in every component; exchange them"
            )

    def keeps(self, block: PointBlock) -> Booleans:
        low, high = np.array(self.low_mm), np.array(self.high_mm)
        within = (block.xyz_mm >= low) & (block.xyz_mm <= high)
        inside: Booleans = np.asarray(within.all(axis=1))
        return _side(inside, block, self.outside)


@dataclass(frozen=True, slots=True)
class Ball(Selection):
    """Points at most one radius from a centre.

    Attributes:
        outside: invert.
    """

    kind: ClassVar[str] = "sphere"
    centre_mm: Vector
    radius_mm: float
    outside: bool = False

    def __post_init__(self) -> None:
        check_positive(self.radius_mm, "radius_mm")

    def keeps(self, block: PointBlock) -> Booleans:
        away_mm = block.xyz_mm - np.array(self.centre_mm)
        inside: Booleans = np.einsum("ij,ij->i", away_mm, away_mm) <= self.radius_mm**2
        return _side(inside, block, self.outside)


@dataclass(frozen=True, slots=True)
class Slab(Selection):
    """Points between two parallel planes.

    Attributes:
        normal: across the planes, any length above 0.
        from_mm, to_mm: their distances from the origin, along the normal.
        outside: invert.
    """

    kind: ClassVar[str] = "slab"
    normal: Vector
    from_mm: float
    to_mm: float
    outside: bool = False

    def __post_init__(self) -> None:
        unit(self.normal, "normal")
        if not self.from_mm <= self.to_mm:
            raise ValueError(
                f"from_mm {self.from_mm:g} is not below to_mm {self.to_mm:g}"
            )

    def keeps(self, block: PointBlock) -> Booleans:
        height_mm = block.xyz_mm @ unit(self.normal, "normal")
        inside = (height_mm >= self.from_mm) & (height_mm <= self.to_mm)
        return _side(inside, block, self.outside)


def _side(inside: Booleans, block: PointBlock, outside: bool) -> Booleans:
    """Select the configured side; a point without a place is on neither."""
    if not outside:
        return inside
    known: Booleans = np.asarray(np.isfinite(block.xyz_mm).all(axis=1))
    return known & ~inside
