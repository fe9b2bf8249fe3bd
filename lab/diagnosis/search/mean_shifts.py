"""Shifts of single poses beside anything else that explains rows.

A blunder is a shift of its own of one pose (the mean-shift model of outliers). With S
the shifts of the poses left out, Q a basis of all else and M = I - Q Q^T,

    b = W S^T v,    W = (S^T M S)^-1,    cost = |v|^2 - v^T S b + sum of c^2

where c^2 is the statistic at which a single pose is left out.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

_MOST_ROUNDS = 12
# Poses leave together when their statistic is above this part of the worst one's.
_NEAR_THE_WORST = 0.16
# Of a unit variance: what less is left of controls nothing.
_UNCONTROLLED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PoseGroup:
    """Poses with equally many rows.

    Attributes:
        poses: Of the campaign, (n,).
        places: Of their rows, (n, n_rows_each).
        limit: c^2.
    """

    poses: Integers
    places: Integers
    limit: float


@dataclass(frozen=True, slots=True, eq=False)
class MeanShifts:
    """Poses that are left out.

    Attributes:
        poses: Which, (n_shifted,).
        places: Rows of each.
        limits: c^2 of each, (n_shifted,).
        rows: All places, (n_shifted_rows,).
        weights: W.
        sizes: b, (n_shifted_rows,).
        sum_of_squares: That is left, without the cost of the shifts.
    """

    poses: Integers
    places: tuple[Integers, ...]
    limits: Floats
    rows: Integers
    weights: Floats
    sizes: Floats
    sum_of_squares: float

    @property
    def cost(self) -> float:
        """Squares that are left, and c^2 of every shifted pose."""
        return self.sum_of_squares + float(np.sum(self.limits))

    @property
    def statistics(self) -> Floats:
        """Of each pose's shift beside all others, (n_shifted,)."""
        return self._statistics(self.weights, self.sizes)

    def statistics_with(self, directions: Floats, along: Floats) -> Floats:
        """Compute the statistics of the shifts if something else is absorbed too.

        Args:
            directions: U, orthonormal and across the basis, (n_rows, n_more).
            along: U^T v, (n_more,).

        Returns:
            (n_shifted,).
        """
        more = directions[self.rows]
        turned = self.weights @ more
        inner = np.eye(len(along)) - more.T @ turned
        inverse = np.linalg.pinv(inner, rcond=_UNCONTROLLED, hermitian=True)
        weights = self.weights + turned @ inverse @ turned.T
        sizes = self.sizes + turned @ (inverse @ (more.T @ self.sizes - along))
        return self._statistics(weights, sizes)

    def _statistics(self, weights: Floats, sizes: Floats) -> Floats:
        found, first = np.zeros(len(self.poses)), 0
        for at, places in enumerate(self.places):
            own = slice(first, first + len(places))
            first = own.stop
            inverse = np.linalg.pinv(weights[own, own], hermitian=True)
            found[at] = sizes[own] @ inverse @ sizes[own]
        return found


def pose_groups(
    rows: ObservationEquations, limits: dict[int, float]
) -> tuple[PoseGroup, ...]:
    """Sort poses by how many rows they have.

    Args:
        rows: Of a fit.
        limits: c^2 by the number of rows.
    """
    order = np.argsort(rows.poses, kind="stable")
    poses, first, sizes = np.unique(
        rows.poses[order], return_index=True, return_counts=True
    )
    found = []
    for size, limit in limits.items():
        mine = (poses >= 0) & (sizes == size)
        places = order[first[mine][:, np.newaxis] + np.arange(size)]
        found.append(PoseGroup(poses[mine], places, limit))
    return tuple(found)


def shifted(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, poses: Booleans
) -> MeanShifts:
    """Estimate the shifts of some poses.

    Args:
        groups: All poses.
        basis: Of all else, orthonormal, (n_rows, n_absorbed).
        residuals: v, without what the basis absorbs, (n_rows,).
        poses: Which are shifted, of all the campaign's, (n_poses,).
    """
    numbers: list[int] = []
    places: list[Integers] = []
    limits: list[float] = []
    for group in groups:
        mine = np.flatnonzero(poses[group.poses])
        numbers += group.poses[mine].tolist()
        places += list(group.places[mine])
        limits += [group.limit] * len(mine)
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *places])
    own = basis[rows]
    weights = np.linalg.pinv(
        np.eye(len(rows)) - own @ own.T, rcond=_UNCONTROLLED, hermitian=True
    )
    sizes = weights @ residuals[rows]
    return MeanShifts(
        np.array(numbers, dtype=np.int64),
        tuple(places),
        np.array(limits),
        rows,
        weights,
        sizes,
        float(residuals @ residuals - residuals[rows] @ sizes),
    )


def best_mean_shifts(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, start: Booleans
) -> MeanShifts:
    """Choose who is left out so that the cost is low.

    Args:
        groups: All poses.
        basis: Of all else, orthonormal, (n_rows, n_absorbed).
        residuals: v, without what the basis absorbs, (n_rows,).
        start: Who is left out to begin with, (n_poses,).
    """
    poses = start.copy()
    best = found = shifted(groups, basis, residuals, poses)
    seen = {poses.tobytes()}
    for _ in range(_MOST_ROUNDS):
        back = found.poses[found.statistics < found.limits]
        leaving = _leaving(groups, basis, residuals, found)
        poses = poses.copy()
        poses[back], poses[leaving] = False, True
        if poses.tobytes() in seen:
            break
        seen.add(poses.tobytes())
        found = shifted(groups, basis, residuals, poses)
        if found.cost < best.cost:
            best = found
    return best


def _leaving(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, found: MeanShifts
) -> Integers:
    """Find the poses that contradict what is left, the worst and those near it."""
    own = basis[found.rows]
    left = residuals + basis @ (own.T @ found.sizes)
    left[found.rows] -= found.sizes
    # M S W S^T M, the part of M that the shifts take.
    root = np.linalg.cholesky(found.weights + 1e-12 * np.eye(len(found.rows)))
    taken = -(basis @ (own.T @ root))
    taken[found.rows] += root
    poses, parts = [], []
    for group in groups:
        inside = ~np.isin(group.poses, found.poses)
        places = group.places[inside]
        absorbed, shares = basis[places], taken[places]
        block = np.eye(places.shape[1]) - absorbed @ absorbed.swapaxes(1, 2)
        block = block - shares @ shares.swapaxes(1, 2)
        values, vectors = np.linalg.eigh(block)
        along = np.einsum("nij,ni->nj", vectors, left[places])
        good = values > _UNCONTROLLED
        statistics = np.sum(
            np.where(good, along**2 / np.where(good, values, 1.0), 0.0), axis=1
        )
        poses.append(group.poses[inside])
        parts.append(statistics / group.limit)
    every, sizes = np.concatenate(poses), np.concatenate(parts)
    worst = float(np.max(sizes, initial=0.0))
    return np.asarray(every[sizes > max(1.0, _NEAR_THE_WORST * worst)])
