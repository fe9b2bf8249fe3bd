"""Filters by place: a box, a ball, a slab between two planes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.filters.point_filter import (
    Selection,
    Vector,
    check_positive,
    unit,
)
from traverse.kinematics.filters.points import PointBlock


@dataclass(frozen=True, slots=True)
class Box(Selection):
    """Points in a box along the axes of the arm's system, its surface included.

    Attributes:
        low_mm, high_mm: two opposite corners.
        outside: let pass what is not in it.
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
        """Which points pass, (n,)."""
        low, high = np.array(self.low_mm), np.array(self.high_mm)
        within = (block.xyz_mm >= low) & (block.xyz_mm <= high)
        inside: Booleans = np.asarray(within.all(axis=1))
        return _side(inside, block, self.outside)


@dataclass(frozen=True, slots=True)
class Ball(Selection):
    """Points at most one radius from a centre.

    Attributes:
        outside: let pass what is further away.
    """

    kind: ClassVar[str] = "sphere"
    centre_mm: Vector
    radius_mm: float
    outside: bool = False

    def __post_init__(self) -> None:
        check_positive(self.radius_mm, "radius_mm")

    def keeps(self, block: PointBlock) -> Booleans:
        """Which points pass, (n,)."""
        away_mm = block.xyz_mm - np.array(self.centre_mm)
        inside: Booleans = np.einsum("ij,ij->i", away_mm, away_mm) <= self.radius_mm**2
        return _side(inside, block, self.outside)


@dataclass(frozen=True, slots=True)
class Slab(Selection):
    """Points between two parallel planes.

    Attributes:
        normal: across the planes, any length above 0.
        from_mm, to_mm: their distances from the origin, along the normal.
        outside: let pass what is not between them.
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
        """Which points pass, (n,)."""
        height_mm = block.xyz_mm @ unit(self.normal, "normal")
        inside = (height_mm >= self.from_mm) & (height_mm <= self.to_mm)
        return _side(inside, block, self.outside)


def _side(inside: Booleans, block: PointBlock, outside: bool) -> Booleans:
    """Select the configured side; a point without a place is on neither."""
    if not outside:
        return inside
    known: Booleans = np.asarray(np.isfinite(block.xyz_mm).all(axis=1))
    return known & ~inside
