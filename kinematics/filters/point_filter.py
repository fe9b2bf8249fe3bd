"""Points in the order of time, and the base class of their filters.

The result is the same however the stream is cut into blocks.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Indices, Integers


@dataclass(frozen=True, slots=True, eq=False)
class PointBlock:
    """n successive points.

    Attributes:
        seq: (n,) int64, number of the sample.
        time_ns: (n,) int64, not decreasing.
        xyz_mm: (n, 3) centre of the ball.
        ijk: (n, 3) the shank.
        angles_rad: (n, n_joints) readings.
        counts: (n, n_joints) int64.
        quality: (n,) uint32, bits set by the source of the points; filters keep them.
        covariance_mm2: (n, 6) xx, xy, xz, yy, yz, zz of the centre; NaN where unknown.
    """

    seq: Integers
    time_ns: Integers
    xyz_mm: Floats
    ijk: Floats
    angles_rad: Floats
    counts: Integers
    quality: NDArray[np.uint32]
    covariance_mm2: Floats

    def __len__(self) -> int:
        return len(self.seq)

    def rows(self, selection: Booleans | Indices | slice) -> "PointBlock":
        return replace(
            self, **{name: getattr(self, name)[selection] for name in _COLUMNS}
        )

    def after(self, before: "PointBlock | None") -> "PointBlock":
        return self if before is None else PointBlock.joined([before, self])

    def between(self, rows: Indices, shares: Floats) -> "PointBlock":
        """Interpolate between each of ``rows`` and the next point.

        Args:
            rows: (m,) indices below n - 1.
            shares: (m,) fractions, 0 to 1.

        Returns:
            m points: interpolated linearly; numbers and counts of the nearer sample,
            the quality bits of both.
        """
        nearer = rows + (shares > 0.5)
        column = shares[:, np.newaxis]

        def mixed(values: Floats) -> Floats:
            return values[rows] + column * (values[rows + 1] - values[rows])

        step_ns = shares * (self.time_ns[rows + 1] - self.time_ns[rows])
        ijk = mixed(self.ijk)
        lengths = np.linalg.norm(ijk, axis=1, keepdims=True)
        return PointBlock(
            self.seq[nearer],
            self.time_ns[rows] + np.rint(step_ns).astype(np.int64),
            mixed(self.xyz_mm),
            np.divide(ijk, lengths, out=ijk, where=lengths > 0.0),
            mixed(self.angles_rad),
            self.counts[nearer],
            self.quality[rows] | self.quality[rows + 1],
            mixed(self.covariance_mm2),
        )

    @staticmethod
    def joined(blocks: Sequence["PointBlock"]) -> "PointBlock":
        return PointBlock(
            *(
                np.concatenate([getattr(block, name) for block in blocks])
                for name in _COLUMNS
            )
        )


_COLUMNS = tuple(field.name for field in fields(PointBlock))


Vector = tuple[float, float, float]


class PointFilter(ABC):
    """Takes points in the order of time and passes some of them.

    A stream may be cut into blocks in any way. The memory of a filter is bounded;
    `restart` clears it.
    """

    kind: ClassVar[str]
    """Name in configurations and commands."""

    interpolates: ClassVar[bool] = False
    """Its points lie between samples, which publishers must state."""

    @abstractmethod
    def apply(self, block: PointBlock) -> PointBlock:
        """Return the points of a block that pass."""

    def restart(self) -> None:  # noqa: B027 - most filters remember nothing
        """Forget all points so far."""


class Selection(PointFilter):
    """A filter that judges every point by itself."""

    def apply(self, block: PointBlock) -> PointBlock:
        kept = self.keeps(block)
        return block if kept.all() else block.rows(kept)

    @abstractmethod
    def keeps(self, block: PointBlock) -> Booleans:
        """Return which points pass, (n,)."""


def check_positive(value: float, key: str) -> None:
    """Check a length above 0.

    Raises:
        ValueError: names the key.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{key} is {value:g}; expected a finite number above 0")


def unit(vector: Vector, key: str) -> Floats:
    """Return the direction of a nonzero vector, (3,).

    Raises:
        ValueError: names the key.
    """
    values = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(values))
    if values.shape != (3,) or not math.isfinite(length) or length == 0.0:
        raise ValueError(
            f"{key} is {list(vector)}; expected 3 finite numbers, not all 0"
        )
    return values / length
