"""A probe checked by pivoting in a cone: where its ball is on the last element.

The ball stays where it is while the arm moves: with e the end of the last link, P its
rotation and p the vector to the ball in the base posture,

    e_i + P_i p = c        for all i,

linear in p and c, and with the arm as it is known.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.plurals import counted

_LEAST_POSES = 4
# Of the smallest singular value to the largest: below, the poses hardly differ.
_FLAT = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Pivot:
    """A probe vector that was found by pivoting.

    Attributes:
        vector_mm: From the end of the last link to the ball, base posture, (3,).
        covariance_mm2: Of it, from the scatter of the poses, (3, 3).
        seat_mm: Where the ball sat, (3,).
        rms_mm: Of the distances of the poses' balls from the seat.
    """

    vector_mm: Floats
    covariance_mm2: Floats
    seat_mm: Floats
    rms_mm: float
    redundancy: int


def fit_pivot(vector_mm: Floats, centres_mm: Floats, by_vector: Floats) -> Pivot:
    """Find the probe vector from poses with the ball in one seat.

    Args:
        vector_mm: Where the fit begins, base posture, (3,).
        centres_mm: Of the ball with that vector, (n_poses, 3).
        by_vector: How they change with it, P_i, (n_poses, 3, 3).

    Raises:
        ValueError: Too few poses, or their rotations hardly differ.
    """
    n = len(centres_mm)
    if n < _LEAST_POSES:
        n_poses = counted(n, "pose")
        raise ValueError(f"{n_poses} in the cone, expected at least {_LEAST_POSES}")
    # Unknowns: the change of p, and the seat relative to the mean of the balls.
    mean_mm = centres_mm.mean(axis=0)
    seats = np.broadcast_to(-np.eye(3), (n, 3, 3))
    design = np.concatenate([by_vector, seats], axis=2).reshape(3 * n, 6)
    misses_mm = (mean_mm - centres_mm).reshape(3 * n)
    singular = np.linalg.svd(design, compute_uv=False)
    if singular[-1] < _FLAT * singular[0]:
        raise ValueError(
            "the poses in the cone hardly differ in how the probe stands: tilt and "
            "turn it as far as the cone allows"
        )
    solution, _, _, _ = np.linalg.lstsq(design, misses_mm, rcond=None)
    left_mm = misses_mm - design @ solution
    redundancy = 3 * n - 6
    variance = float(left_mm @ left_mm) / redundancy
    cofactors = np.linalg.inv(design.T @ design)
    return Pivot(
        vector_mm + solution[:3],
        variance * cofactors[:3, :3],
        mean_mm + solution[3:],
        float(np.sqrt(left_mm @ left_mm / n)),
        redundancy,
    )
