"""Orthogonal elimination: tall systems to small triangles, a part at a time.

A triangle R stands for all rows A seen so far: R^T R = A^T A. The station's own
unknowns come first in the columns, so that the rows of R below them hold what the
station says about the arm alone.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats

# Rows gathered before each factorisation.
_STACKED_ROWS = 4096
# Numbers in a block that is factored at a time. Small enough for the cache, and for
# linear algebra libraries not to share it between threads, which costs more than it
# brings for matrices this narrow (six times more on two busy cores).
_BLOCK_SIZE = 7500


@dataclass(frozen=True, slots=True, eq=False)
class Elimination:
    """A station's unknowns as functions of the arm's parameters.

    With the step d of the parameters, the unknowns step by gain (right - left d).

    Attributes:
        gain: (n_unknowns, n_determined).
        left: (n_determined, n_free).
        right: (n_determined,).
        reduced: What is left for the arm, parameters and right side,
            (n_left, n_free + 1).
        held: Directions that the station's poses do not determine, in units of
            their scales, (n_held, n_unknowns).
    """

    gain: Floats
    left: Floats
    right: Floats
    reduced: Floats
    held: Floats

    def step(self, arm_step: Floats) -> Floats:
        """Compute the step of the unknowns, (n_unknowns,)."""
        step: Floats = self.gain @ (self.right - self.left @ arm_step)
        return step


def sequential_qr(blocks: Iterable[Floats], n_columns: int) -> Floats:
    """Reduce rows to a triangle, (at most n_columns, n_columns)."""
    reduced = np.empty((0, n_columns))
    gathered: list[Floats] = []
    n_rows = 0
    for block in blocks:
        gathered.append(block)
        n_rows += len(block)
        if n_rows >= _STACKED_ROWS:
            reduced = _factor(np.vstack([reduced, *gathered]))
            gathered, n_rows = [], 0
    return _factor(np.vstack([reduced, *gathered]))


def eliminate_unknowns(upper: Floats, scales: Floats) -> Elimination:
    """Take a station's unknowns out of its triangle.

    Args:
        upper: Columns: unknowns, parameters, right side; at most as many rows.
        scales: Hopeless standard deviations of the unknowns. A direction that is
            known worse than that is held, and its equation left to the arm.
    """
    n_unknowns = len(scales)
    own, others = (
        upper[:n_unknowns, :n_unknowns] * scales,
        upper[:n_unknowns, n_unknowns:],
    )
    left, values, right = np.linalg.svd(own)
    n_determined = int(np.count_nonzero(values > 1.0))
    turned = left.T @ others
    known = turned[:n_determined]
    gain = scales[:, np.newaxis] * right[:n_determined].T / values[:n_determined]
    return Elimination(
        gain=gain,
        left=known[:, :-1],
        right=known[:, -1],
        reduced=np.vstack([turned[n_determined:], upper[n_unknowns:, n_unknowns:]]),
        held=right[n_determined:],
    )


def _factor(rows: Floats) -> Floats:
    """Factor rows in blocks, then the blocks' triangles, until one is left."""
    n_columns = rows.shape[1]
    block_rows = max(_BLOCK_SIZE // n_columns, 2 * n_columns)
    while len(rows) > block_rows:
        n_blocks = -(-len(rows) // block_rows)
        padded = np.zeros((n_blocks * block_rows, n_columns))
        padded[: len(rows)] = rows
        blocks = padded.reshape(n_blocks, block_rows, n_columns)
        rows = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, n_columns)
    return np.asarray(np.linalg.qr(rows, mode="r"))
