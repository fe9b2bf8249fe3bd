"""Reliability of an adjusted Helmert transformation, after W. Baarda (1968).

An error e of point i enters the residuals through B = P - P J Q J' P, the block of
point i (P = S^-1): the noncentrality that it gives to a test is e'B e. What B does not
see stays in the transformation: it moves by Q J' P e.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.adjustment import AdjustedHelmert

# Of the weight of a point: eigenvalues of B below are rounding.
_UNSEEN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Reliability of n points.

    Attributes:
        shares: Redundancy numbers of the coordinates; all together the redundancy,
            (n, 3). Near 0: an error there distorts the transformation.
        seen_per_mm2: Eigenvalues of B, the least first, (n, 3); 0 where an error in
            that direction cannot be revealed by any test.
        directions: Of these, as rows, (n, 3, 3).
        moves: Q J' P, what an error of a point does to xi, (n, p, 3).
    """

    shares: Floats
    seen_per_mm2: Floats
    directions: Floats
    moves: Floats


def reliability_of(adjusted: AdjustedHelmert) -> Reliability:
    """Compute what an adjustment could reveal."""
    weights = np.linalg.inv(adjusted.misclosure_covariance_mm2)
    design, cofactors = adjusted.design, adjusted.cofactors
    weighted = weights @ design
    moves = cofactors @ np.swapaxes(weighted, 1, 2)
    hat = design @ moves
    shares = 1.0 - np.einsum("nii->ni", hat)
    seen = weights - weighted @ moves
    sizes, vectors = np.linalg.eigh(0.5 * (seen + np.swapaxes(seen, 1, 2)))
    least = _UNSEEN * np.einsum("nii->n", weights)[:, np.newaxis]
    return Reliability(
        shares=shares,
        seen_per_mm2=np.where(sizes > least, sizes, 0.0),
        directions=np.swapaxes(vectors, 1, 2),
        moves=moves,
    )


def point_statistics(adjusted: AdjustedHelmert, found: Reliability) -> Floats:
    """Compute the statistic of every point: chi-squared of its detectable part.

    Returns:
        (n,), with as many degrees of freedom as `seen_per_mm2` has values above 0.
    """
    weighted = np.linalg.solve(
        adjusted.misclosure_covariance_mm2, adjusted.misclosures_mm[:, :, np.newaxis]
    )[..., 0]
    parts = np.einsum("nki,ni->nk", found.directions, weighted)
    seen = found.seen_per_mm2
    squares = np.divide(parts**2, seen, out=np.zeros_like(seen), where=seen > 0.0)
    total: Floats = squares.sum(axis=1)
    return total
