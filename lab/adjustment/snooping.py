"""Reliability of every pose: tests, controllability, what would stay undetected.

With whitened rows A = [A_z, A_p] of a pose, and Y = A T^-1 for the triangle T of the
whole system, the pose's block of the projector on residuals is M = I - Y Y^T. Then

    statistic       v^T M^+ v, chi-square with rank(M) degrees of freedom
    controllability trace(M) / n_rows, the redundancy numbers' mean
    detectable      delta_0 / sqrt(smallest eigenvalue of L^-T M L^-1) [mm]

Where an orientation was measured the pose has six rows, and both parts are also tested
alone: with L (M) L^T the dispersion of their residuals, each by its own block of it.

A pose that took no part in the adjustment has M = I + Y Y^T instead.

Data snooping: poses that contradict the others are excluded, and may return.

The worst contradict first, because one blunder makes its neighbours look bad; with
many poses several leave at a time, all those near the worst. Whoever agrees with the
estimates of the rest is taken back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.lab.adjustment.equations import WhiteRows, white_rows
from traverse.lab.adjustment.noise import VarianceSums
from traverse.lab.adjustment.problem import Network, Station, stations
from traverse.lab.adjustment.rank import Elimination
from traverse.lab.adjustment.solve import Adjustment
from traverse.lab.statistics.distributions import (
    equivalent_normal,
    median_of_chi_square,
    normal_quantile,
    student_critical,
    tau_critical,
)

# Non-centrality for a level of 0.1 % and a power of 80 %.
DETECTABLE = 4.13


_UNCONTROLLED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PoseStatistics:
    """One entry a pose of the campaign, NaN for poses that were not looked at.

    Attributes:
        misclosures_mm: (n_poses, 3); surfaces have only the first.
        statistics: Chi-square statistics, (n_poses,).
        w: |w| of a normal with the same p-value, (n_poses,).
        degrees: Of freedom, (n_poses,).
        controllability: Between 0 and 1, (n_poses,).
        detectable_mm: Smallest contact error that the test finds, (n_poses,).
        corrections_rad: Of the readings, (n_poses, n_joints).
        orientation_errors_rad: Misclosures of orientations, (n_poses, 3).
        w_position: As `w`, of the position of a pose with an orientation, (n_poses,).
        w_orientation: Of its orientation, (n_poses,).
    """

    misclosures_mm: Floats
    statistics: Floats
    w: Floats
    degrees: Floats
    controllability: Floats
    detectable_mm: Floats
    corrections_rad: Floats
    orientation_errors_rad: Floats
    w_position: Floats
    w_orientation: Floats
    variances: "VarianceSums"

    def fill(self, others: "PoseStatistics", poses: Booleans) -> None:
        """Take the entries of some poses (n_poses,) from others; not the sums."""
        for field in fields(self):
            if field.name != "variances":
                entries = getattr(self, field.name)
                entries[poses] = getattr(others, field.name)[poses]


def pose_statistics(
    adjustment: Adjustment, outsiders: Sequence[Station] | None = None
) -> PoseStatistics:
    """Compute the statistics of all poses that took part.

    Or of outsiders: poses that took no part, at the same artefacts.
    """
    network = adjustment.network
    sign = -1.0 if outsiders is None else 1.0
    found = _empty(network)
    places = {station.index: at for at, station in enumerate(network.stations)}
    inverse = adjustment.split.inverse
    for station in network.stations if outsiders is None else outsiders:
        at = places.get(station.index)
        if at is None:
            continue
        elimination = adjustment.system.eliminations[at]
        unknowns = adjustment.state.unknowns[at]
        arm = adjustment.state.arm
        # Outsiders have no corrections: they are tested as they were read.
        corrections = adjustment.state.corrections[at] if outsiders is None else None
        for rows in white_rows(network, station, arm, unknowns, corrections):
            block = _blocks(rows, elimination, inverse, sign)
            poses = station.poses[rows.part]
            corrections = np.einsum("nij,ni->nj", rows.by_readings, rows.misclosures)
            found.corrections_rad[poses] = -corrections * network.noise.encoder_rad
            _add_tests(found, poses, rows, block)
            _add_variances(found.variances, station.index, rows, block)
    return found


def _blocks(
    rows: WhiteRows, elimination: Elimination, inverse: Floats, sign: float
) -> Floats:
    """Compute I + sign Y Y^T of every pose, (n_poses, n_rows, n_rows)."""
    own = rows.by_unknowns @ elimination.gain
    arm = (rows.by_parameters - own @ elimination.left) @ inverse
    by_own, by_arm = own @ own.swapaxes(1, 2), arm @ arm.swapaxes(1, 2)
    return np.eye(by_own.shape[1]) + sign * (by_own + by_arm)


def _add_tests(
    found: PoseStatistics,
    poses: Integers,
    rows: WhiteRows,
    block: Floats,
) -> None:
    n_rows = rows.misclosures.shape[1]
    values, vectors = np.linalg.eigh(block)
    good = values > _UNCONTROLLED
    along = np.einsum("nij,ni->nj", vectors, rows.misclosures)
    safe = np.where(good, values, 1.0)
    found.statistics[poses] = np.sum(np.where(good, along**2 / safe, 0.0), axis=1)
    found.degrees[poses] = np.count_nonzero(good, axis=1)
    found.w[poses] = equivalent_normal(found.statistics[poses], found.degrees[poses])
    found.controllability[poses] = np.clip(np.mean(values, axis=1), 0.0, 1.0)
    found.misclosures_mm[poses, : min(n_rows, 3)] = rows.misclosures_mm
    by_contact = rows.whiteners[:, :, :3]
    in_mm = by_contact.swapaxes(1, 2) @ block @ by_contact
    smallest = np.linalg.eigvalsh(in_mm)[:, 0]
    floor = _UNCONTROLLED * np.einsum("nij,nij->n", by_contact, by_contact)
    found.detectable_mm[poses] = DETECTABLE / np.sqrt(np.maximum(smallest, floor))
    if n_rows > 3:
        _add_parts(found, poses, rows, block)


def _add_parts(
    found: PoseStatistics, poses: Integers, rows: WhiteRows, block: Floats
) -> None:
    """Test position and orientation each by itself."""
    lower = np.linalg.inv(rows.whiteners)
    dispersion = lower @ block @ lower.swapaxes(1, 2)
    misclosures = (lower @ rows.misclosures[:, :, np.newaxis])[:, :, 0]
    for entries, part in (
        (found.w_position, slice(0, 3)),
        (found.w_orientation, slice(3, 6)),
    ):
        # In units of its own noise, so that millimetres and radians are alike.
        own = lower[:, part] @ lower[:, part].swapaxes(1, 2)
        white = np.linalg.inv(np.linalg.cholesky(own))
        values, vectors = np.linalg.eigh(
            white @ dispersion[:, part, part] @ white.swapaxes(1, 2)
        )
        good = values > _UNCONTROLLED
        seen = (white @ misclosures[:, part, np.newaxis])[:, :, 0]
        along = np.einsum("nij,ni->nj", vectors, seen)
        squares = np.where(good, along**2 / np.where(good, values, 1.0), 0.0)
        degrees = np.count_nonzero(good, axis=1).astype(np.float64)
        entries[poses] = equivalent_normal(np.sum(squares, axis=1), degrees)
    found.orientation_errors_rad[poses] = rows.unweighted[:, 3:]


def _add_variances(
    sums: VarianceSums, artefact: int, rows: WhiteRows, block: Floats
) -> None:
    n_joints = rows.by_readings.shape[2]
    sources = np.concatenate([rows.by_readings, rows.by_contact], axis=2)
    squares = np.sum(np.einsum("nij,ni->nj", sources, rows.misclosures) ** 2, axis=0)
    shared = sources.swapaxes(1, 2) @ block @ sources
    # The components of a contact are one source, and those of all orientations.
    of_source = np.concatenate(
        [
            np.arange(n_joints),
            np.full(3, n_joints + artefact),
            np.full(rows.by_contact.shape[2] - 3, len(sums.squares) - 1),
        ]
    )
    np.add.at(sums.squares, of_source, squares)
    np.add.at(sums.redundancies, of_source, np.einsum("njj->j", shared))
    information = np.einsum("nij,nij->ij", shared, shared)
    np.add.at(sums.information, np.ix_(of_source, of_source), information)
    for at, part in enumerate((slice(0, 3), slice(3, 6))):
        sums.of_parts[0, at] += np.sum(rows.misclosures[:, part] ** 2)
        sums.of_parts[1, at] += np.sum(np.einsum("nii->ni", block)[:, part])


def _empty(network: Network) -> PoseStatistics:
    campaign = network.campaign
    n_poses, n_joints = len(campaign.poses), len(campaign.joint_names)
    n_sources = n_joints + len(campaign.artefacts) + 1
    return PoseStatistics(
        misclosures_mm=np.full((n_poses, 3), np.nan),
        statistics=np.full(n_poses, np.nan),
        w=np.full(n_poses, np.nan),
        degrees=np.full(n_poses, np.nan),
        controllability=np.full(n_poses, np.nan),
        detectable_mm=np.full(n_poses, np.nan),
        corrections_rad=np.full((n_poses, n_joints), np.nan),
        orientation_errors_rad=np.full((n_poses, 3), np.nan),
        w_position=np.full(n_poses, np.nan),
        w_orientation=np.full(n_poses, np.nan),
        variances=VarianceSums(
            np.zeros(n_sources),
            np.zeros(n_sources),
            np.zeros((n_sources, n_sources)),
            np.zeros((2, 2)),
        ),
    )


# Poses leave together when their |w| is above this part of the worst one's.
_NEAR_THE_WORST = 0.4


# An artefact keeps at least this part of its poses: else the artefact is wrong.
_LEAST_PART = 0.5


def snoop(
    adjustment: Adjustment,
    found: PoseStatistics,
    included: Booleans,
    eligible: Booleans,
    *,
    family_level: float,
    noise_known: bool,
    radius_mm: float,
) -> tuple[Booleans, float]:
    """Decide who of the eligible poses takes part in the next adjustment, (n_poses,).

    And the |w| above which a pose is excluded.
    A campaign without blunders loses any pose with the probability of the family. Where
    the noise is known the test is that of w, else that of tau.
    """
    n_poses = max(int(np.count_nonzero(included)), 1)
    level = family_level / n_poses
    scale = robust_scale(found)
    if noise_known:
        scale = max(scale, 1.0)
        critical = returning = -normal_quantile(0.5 * level)
    else:
        # Those outside took no part in the estimate of the noise.
        critical = tau_critical(level, max(adjustment.redundancy, 2))
        returning = student_critical(level, adjustment.redundancy)
    w = np.where(included, np.nan_to_num(found.w) / scale, 0.0)
    worst = float(np.max(w, initial=0.0))
    leaving = w > max(critical, _NEAR_THE_WORST * worst)
    leaving &= _not_too_many(adjustment, w, leaving)
    network = adjustment.network
    outside = eligible & ~included
    back = np.zeros_like(included)
    if np.any(outside):
        others = stations(network.campaign, radius_mm, outside)
        theirs = pose_statistics(adjustment, others).w / scale
        back = outside & (np.nan_to_num(theirs, nan=np.inf) < returning)
    return (included & ~leaving) | back, critical * scale


def robust_scale(found: PoseStatistics) -> float:
    """Estimate sigma0 from the medians of the statistics of each kind of pose."""
    squares, weights = [], []
    for degrees in range(1, 7):
        mine = found.degrees == degrees
        if np.count_nonzero(mine) >= 5:
            median = float(np.median(found.statistics[mine]))
            squares.append(median / median_of_chi_square(degrees))
            weights.append(np.count_nonzero(mine) * degrees)
    if not squares:
        return 1.0
    return float(np.sqrt(np.average(squares, weights=weights)))


def _not_too_many(adjustment: Adjustment, w: Floats, leaving: Booleans) -> Booleans:
    """Keep the better half of every artefact's poses."""
    may_leave = np.ones_like(leaving)
    poses_of = adjustment.network.campaign.poses.artefacts
    for station in adjustment.network.stations:
        total = np.count_nonzero(poses_of == station.index)
        spare = len(station.poses) - int(np.ceil(_LEAST_PART * total))
        mine = station.poses[leaving[station.poses]]
        if len(mine) > spare:
            order = mine[np.argsort(w[mine])]
            may_leave[order[: len(mine) - max(spare, 0)]] = False
    return may_leave


# Part of an expectation's variance in its residual, below which poses do not test it:
# what is left of the last step would pass for a contradiction.
_UNTESTABLE = 0.01


# Probability that an arm of the family contradicts it in any parameter.
_FAMILY_LEVEL = 0.01


def contradicted_expectation(adjustment: Adjustment) -> tuple[str, float] | None:
    """Name the parameter that contradicts the arm's family most, if one does.

    And by how many standard deviations, as in Baarda's test of single observations.
    """
    parameters = adjustment.network.parameters
    expected = parameters.family_expectations(adjustment.state.arm)
    if len(expected) == 0:
        return None
    inverse = expected[:, :-1] @ adjustment.split.inverse
    left = 1.0 - np.sum(inverse**2, axis=1)
    sizes = np.abs(expected[:, -1]) / np.sqrt(np.maximum(left, _UNTESTABLE))
    w = np.where(left > _UNTESTABLE, sizes, 0.0)
    at = int(np.argmax(w))
    if w[at] < -normal_quantile(0.5 * _FAMILY_LEVEL / len(w)):
        return None
    return parameters.free_names[int(np.argmax(expected[at, :-1]))], float(w[at])
