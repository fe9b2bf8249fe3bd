"""Base class of filters: blocks in, fewer points out, the same however cut."""

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.filters.points import PointBlock

Vector = tuple[float, float, float]


class PointFilter(ABC):
    """Takes points in the order of time and passes some of them.

    A stream may be cut into blocks in any way: the result is the same. What a filter
    has to remember for that is bounded; `restart` forgets it.
    """

    kind: ClassVar[str]
    """Its name in configurations and commands."""

    interpolates: ClassVar[bool] = False
    """Its points lie between samples: whoever publishes them has to say so."""

    @abstractmethod
    def apply(self, block: PointBlock) -> PointBlock:
        """The points of a block that pass."""

    def restart(self) -> None:  # noqa: B027 - most filters remember nothing
        """Forget all points so far."""


class Selection(PointFilter):
    """A filter that judges every point by itself."""

    def apply(self, block: PointBlock) -> PointBlock:
        """The points of a block that pass."""
        kept = self.keeps(block)
        return block if kept.all() else block.rows(kept)

    @abstractmethod
    def keeps(self, block: PointBlock) -> Booleans:
        """Which points pass, (n,)."""


def check_positive(value: float, key: str) -> None:
    """Refuse what is no length above 0.

    Raises:
        ValueError: naming the key.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{key} is {value:g}; expected a finite number above 0")


def unit(vector: Vector, key: str) -> Floats:
    """The direction of a vector of any length above 0, (3,).

    Raises:
        ValueError: naming the key.
    """
    values = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(values))
    if values.shape != (3,) or not math.isfinite(length) or length == 0.0:
        raise ValueError(
            f"{key} is {list(vector)}; expected 3 finite numbers, not all 0"
        )
    return values / length
