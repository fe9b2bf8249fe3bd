"""Products with the columns of steps, at all gaps between poses at once.

A step at a gap changes all later rows, so its column c is a sum of pieces, one a later
pose, and one running sum from the last pose backwards gives c^T v for every gap. With
the serial correlation R = L L^T of the rows' errors the whitened column is L^-1 c: then
L^-T v takes the place of v, and c^T R^-1 c is a running sum over pairs of poses.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import (  # type: ignore[import-untyped] # scipy ships no types
    solve_triangular,
)

from traverse.arrays import Floats, Integers
from traverse.lab.diagnosis.model.covariates import used_poses
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations


@dataclass(frozen=True, slots=True, eq=False)
class StepSums:
    """The rows of a fit in the order of time, and the gaps between their poses.

    Attributes:
        order: Rows that belong to poses, those of the earliest pose first, (n_later,).
        starts: Where in `order` each pose begins, (n_used,).
        first_after: The first pose after each gap, (n_gaps,).
        at_s: Middles of the gaps in the campaign's time, rising, (n_gaps,).
        root: Lower Cholesky factor of the correlation of the rows' errors, or None.
        inverse: R^-1 of `order`, (n_later, n_later), or None.
    """

    order: Integers
    starts: Integers
    first_after: Integers
    at_s: Floats
    root: Floats | None
    inverse: Floats | None

    def products(self, pieces: Floats, vectors: Floats) -> Floats:
        """Compute c^T v of whitened columns and vectors.

        Args:
            pieces: Columns of a step before all poses, not whitened, (n_rows,
                n_columns).
            vectors: Whitened, (n_rows, n_vectors).

        Returns:
            (n_gaps, n_columns, n_vectors).
        """
        if self.root is not None:
            vectors = solve_triangular(self.root, vectors, lower=True, trans="T")
        vectors, pieces = vectors[self.order], pieces[self.order]
        found = np.empty((len(self.at_s), pieces.shape[1], vectors.shape[1]))
        for at, piece in enumerate(pieces.T):
            of_poses = np.add.reduceat(piece[:, np.newaxis] * vectors, self.starts)
            found[:, at] = self._later(of_poses)
        return found

    def squares(self, pieces: Floats) -> Floats:
        """Compute c^T c of whitened columns.

        Args:
            pieces: As for `products`.

        Returns:
            (n_gaps, n_columns, n_columns).
        """
        pieces = pieces[self.order]
        n_columns = pieces.shape[1]
        found = np.empty((len(self.at_s), n_columns, n_columns))
        for i in range(n_columns):
            for j in range(i + 1):
                of_poses = self._of_poses(pieces[:, i], pieces[:, j])
                found[:, i, j] = found[:, j, i] = self._later(of_poses)
        return found

    def _of_poses(self, a: Floats, b: Floats) -> Floats:
        """What each pose adds to a^T b of itself and all later ones, (n_used,)."""
        if self.inverse is None:
            return np.asarray(np.add.reduceat(a * b, self.starts))
        pairs = np.add.reduceat(a[:, np.newaxis] * self.inverse, self.starts) * b
        pairs = np.add.reduceat(pairs, self.starts, axis=1)
        return np.asarray((np.triu(pairs) + np.triu(pairs.T, 1)).sum(axis=1))

    def _later(self, of_poses: Floats) -> Floats:
        """Add up what is after each gap, (n_used, ...) -> (n_gaps, ...)."""
        return np.asarray(np.cumsum(of_poses[::-1], axis=0)[::-1][self.first_after])


def step_sums_of(rows: ObservationEquations) -> StepSums:
    """Sort the rows of a fit by time.

    Args:
        rows: Of the fit; what belongs to no pose is left out.

    Returns:
        With a gap between any two poses that take part and differ in time.
    """
    times_s = rows.block.row("campaign_s")
    poses = used_poses(rows)
    poses = poses[np.argsort(times_s[poses], kind="stable")]
    ranks = np.zeros(len(times_s), dtype=np.int64)
    ranks[poses] = np.arange(len(poses))
    of_poses = np.flatnonzero(rows.poses >= 0)
    of_rows = ranks[rows.poses[of_poses]]
    by_time = np.argsort(of_rows, kind="stable")
    order = of_poses[by_time]
    ordered_s = times_s[poses]
    first_after = 1 + np.flatnonzero(np.diff(ordered_s) > 0.0)
    return StepSums(
        order=order,
        starts=np.searchsorted(of_rows[by_time], np.arange(len(poses))),
        first_after=first_after,
        at_s=0.5 * (ordered_s[first_after - 1] + ordered_s[first_after]),
        root=rows.root,
        inverse=_inverse(rows.root, order),
    )


def _inverse(root: Floats | None, order: Integers) -> Floats | None:
    if root is None:
        return None
    whitener = solve_triangular(root, np.eye(len(root))[:, order], lower=True)
    inverse: Floats = whitener.T @ whitener
    return inverse
