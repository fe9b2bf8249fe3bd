"""Readmission: poses that were left out as blunders, but that a curve explains.

To a model that lacks a bump in one joint, the poses on the bump look like blunders. So
both explanations are put side by side, over all poses at once:

    values = A d + C nabla + S b + e

with S the shifts of the poses left out. Every curve C may choose anew who is left out
beside it; it is believed if what it lowers the cost by passes the test
of its bank. Blunders anywhere cost as much with the curve as without.

A blunder is a shift of its own of one pose (the mean-shift model of outliers). With S
the shifts of the poses left out, Q a basis of all else and M = I - Q Q^T,

    b = W S^T v,    W = (S^T M S)^-1,    cost = |v|^2 - v^T S b + sum of c^2

where c^2 is the statistic at which a single pose is left out.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from traverse.arrays import Booleans, Floats, Integers
from traverse.lab.adjustment import Options
from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.scoring import (
    ProjectedCandidate,
    log_p_values,
    project,
)
from traverse.lab.diagnosis.model.candidate import has_own_curve
from traverse.lab.diagnosis.model.fit import Fit
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)

_MOST_ROUNDS = 12
# Poses leave together when their statistic is above this part of the worst one's.
_NEAR_THE_WORST = 0.16
# Of a unit variance: what less is left of controls nothing.
_UNCONTROLLED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PoseGroup:
    """Poses with equally many rows, (n,), their rows, (n, n_rows_each), and c^2."""

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
        """Compute the shifts' statistics if something else is absorbed, (n_shifted,).

        Its directions are U, orthonormal and across the basis, (n_rows, n_more), and
        along them is U^T v, (n_more,).
        """
        more = directions[self.rows]
        turned = self.weights @ more
        inner = np.eye(len(along)) - more.T @ turned
        inverse = np.linalg.pinv(inner, rcond=_UNCONTROLLED, hermitian=True)
        weights = self.weights + turned @ inverse @ turned.T
        sizes = self.sizes + turned @ (inverse @ (more.T @ self.sizes - along))
        return self._statistics(weights, sizes)

    def _statistics(self, weights: Floats, sizes: Floats) -> Floats:
        statistics, first = np.zeros(len(self.poses)), 0
        for index, places in enumerate(self.places):
            of_pose = slice(first, first + len(places))
            first = of_pose.stop
            inverse = np.linalg.pinv(weights[of_pose, of_pose], hermitian=True)
            statistics[index] = sizes[of_pose] @ inverse @ sizes[of_pose]
        return statistics


def pose_groups(
    rows: ObservationEquations, limits: dict[int, float]
) -> tuple[PoseGroup, ...]:
    """Sort poses by how many rows they have.

    The limits are c^2 by the number of rows.
    """
    order = np.argsort(rows.poses, kind="stable")
    poses, first, sizes = np.unique(
        rows.poses[order], return_index=True, return_counts=True
    )
    groups = []
    for size, limit in limits.items():
        mine = (poses >= 0) & (sizes == size)
        places = order[first[mine][:, np.newaxis] + np.arange(size)]
        groups.append(PoseGroup(poses[mine], places, limit))
    return tuple(groups)


def shifted(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, poses: Booleans
) -> MeanShifts:
    """Estimate the shifts of some poses, of all the campaign's, (n_poses,).

    The basis of all else is orthonormal, (n_rows, n_absorbed); the residuals are v,
    without what it absorbs, (n_rows,).
    """
    chosen = [(group, np.flatnonzero(poses[group.poses])) for group in groups]
    numbers = np.concatenate([group.poses[mine] for group, mine in chosen])
    places = [rows for group, mine in chosen for rows in group.places[mine]]
    limits = np.repeat(
        [group.limit for group in groups], [len(mine) for _, mine in chosen]
    )
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *places])
    shifted_rows = basis[rows]
    weights = np.linalg.pinv(
        np.eye(len(rows)) - shifted_rows @ shifted_rows.T,
        rcond=_UNCONTROLLED,
        hermitian=True,
    )
    sizes = weights @ residuals[rows]
    return MeanShifts(
        numbers,
        tuple(places),
        limits,
        rows,
        weights,
        sizes,
        float(residuals @ residuals - residuals[rows] @ sizes),
    )


def best_mean_shifts(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, start: Booleans
) -> MeanShifts:
    """Choose who is left out so that the cost is low; see `shifted`.

    To begin with those of the start, (n_poses,), are left out.
    """
    poses = start.copy()
    best = shifts = shifted(groups, basis, residuals, poses)
    seen = {poses.tobytes()}
    for _ in range(_MOST_ROUNDS):
        back = shifts.poses[shifts.statistics < shifts.limits]
        leaving = _leaving(groups, basis, residuals, shifts)
        poses = poses.copy()
        poses[back], poses[leaving] = False, True
        if poses.tobytes() in seen:
            break
        seen.add(poses.tobytes())
        shifts = shifted(groups, basis, residuals, poses)
        if shifts.cost < best.cost:
            best = shifts
    return best


def _leaving(
    groups: tuple[PoseGroup, ...], basis: Floats, residuals: Floats, shifts: MeanShifts
) -> Integers:
    """Find the poses that contradict what is left, the worst and those near it."""
    shifted_rows = basis[shifts.rows]
    left = residuals + basis @ (shifted_rows.T @ shifts.sizes)
    left[shifts.rows] -= shifts.sizes
    # M S W S^T M, the part of M that the shifts take.
    # They may be singular, where so many poses are left out that others decide nothing.
    values, vectors = np.linalg.eigh(shifts.weights)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    removed = -(basis @ (shifted_rows.T @ root))
    removed[shifts.rows] += root
    poses, parts = [], []
    for group in groups:
        inside = ~np.isin(group.poses, shifts.poses)
        places = group.places[inside]
        absorbed, shares = basis[places], removed[places]
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


def recover_outliers(
    fit: Fit,
    eligible: Booleans,
    log_p: float,
    joints_with_own_curve: Collection[str] = (),
) -> Booleans | None:
    """Find who takes part if the best curve is right, (n_poses,).

    A curve is believed below that log p; joints whose own angle has an empirical curve
    already get none. None: no curve explains why poses were left out.
    """
    outside = eligible & ~fit.included
    if not np.any(outside):
        return None
    rows = equations_of_all_poses(fit, eligible)
    groups = pose_groups(rows, _limits(fit, rows))
    plain = best_mean_shifts(groups, rows.basis, rows.residuals, outside)
    start = _mask(eligible, plain)
    chosen, least = None, log_p
    for curve in project(rows, generic_bank(rows)):
        if has_own_curve(curve.candidate, joints_with_own_curve):
            continue
        along = curve.directions.T @ rows.residuals
        # Most curves explain none of them: no need to look further.
        if np.all(plain.statistics_with(curve.directions, along) > plain.limits):
            continue
        basis = np.hstack([rows.basis, curve.directions])
        residuals = rows.residuals - curve.directions @ along
        shifts = best_mean_shifts(groups, basis, residuals, start)
        reached = _log_p(rows, plain, shifts, curve)
        if reached < least and np.any(start & ~_mask(eligible, shifts)):
            chosen, least = shifts, reached
    return None if chosen is None else eligible & ~_mask(eligible, chosen)


def equations_of_all_poses(fit: Fit, eligible: Booleans) -> ObservationEquations:
    """Linearise the equations of all poses where a fit to some of them ended.

    An artefact that took no part at all stays away.
    """
    network, state = fit.adjustment.network, fit.adjustment.state
    n_poses, n_joints = network.campaign.poses.angles_rad.shape
    corrections = np.zeros((n_poses, n_joints + 6))  # three of orientations
    for station, of_poses in zip(network.stations, state.corrections, strict=True):
        corrections[station.poses, : of_poses.shape[1]] = of_poses
    known, unknowns = network.known_stations(state, eligible)
    of_known = tuple(corrections[station.poses] for station in known)
    everyone = replace(state, unknowns=unknowns, corrections=of_known)
    return equations_of(
        replace(
            fit.adjustment, network=replace(network, stations=known), state=everyone
        )
    )


def _limits(fit: Fit, rows: ObservationEquations) -> dict[int, float]:
    """Return the statistic at which a pose is left out, by the number of its rows."""
    poses, sizes = np.unique(rows.poses[rows.poses >= 0], return_counts=True)
    level = Options().family_level / len(poses)
    variance = max(fit.statistics.robust_scale, 1.0) ** 2
    return {
        int(size): variance * float(special.chdtri(size, level))
        for size in np.unique(sizes)
    }


def _log_p(
    rows: ObservationEquations,
    plain: MeanShifts,
    shifts: MeanShifts,
    curve: ProjectedCandidate,
) -> float:
    """Test a curve by the reduction of the cost; as usual if no pose is recovered."""
    gain = max(plain.cost - shifts.cost, 0.0)
    redundancy = rows.redundancy - len(shifts.rows)
    part = np.array([gain / (gain + shifts.sum_of_squares)])
    degrees = np.array([len(curve.singular_values)])
    return float(log_p_values(part, degrees, redundancy)[0])


def _mask(eligible: Booleans, shifts: MeanShifts) -> Booleans:
    mask = np.zeros_like(eligible)
    mask[shifts.poses] = True
    return mask
