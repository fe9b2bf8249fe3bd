"""A block of points in the order of time: what filters take and give."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Indices, Integers


@dataclass(frozen=True, slots=True, eq=False)
class PointBlock:
    """n points, one after the other.

    Attributes:
        seq: (n,) int64, number of the sample.
        time_ns: (n,) int64, not decreasing.
        xyz_mm: (n, 3) centre of the ball.
        ijk: (n, 3) the shank.
        angles_rad: (n, n_joints) readings.
        counts: (n, n_joints) int64.
        quality: (n,) uint32, bits set by the source of the points; filters keep them.
    """

    seq: Integers
    time_ns: Integers
    xyz_mm: Floats
    ijk: Floats
    angles_rad: Floats
    counts: Integers
    quality: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.seq)

    def rows(self, which: Booleans | Indices | slice) -> "PointBlock":
        """Some of the points."""
        return replace(self, **{name: getattr(self, name)[which] for name in _COLUMNS})

    def after(self, before: "PointBlock | None") -> "PointBlock":
        """These points with those of ``before`` in front of them."""
        return self if before is None else PointBlock.joined([before, self])

    def between(self, rows: Indices, shares: Floats) -> "PointBlock":
        """Points on the way from each of ``rows`` to the one after it.

        Args:
            rows: (m,) indices below n - 1.
            shares: (m,) of the way, 0 to 1.

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
        )

    @staticmethod
    def joined(blocks: Sequence["PointBlock"]) -> "PointBlock":
        """Blocks one after the other."""
        return PointBlock(
            *(
                np.concatenate([getattr(block, name) for block in blocks])
                for name in _COLUMNS
            )
        )


_COLUMNS = tuple(field.name for field in fields(PointBlock))
