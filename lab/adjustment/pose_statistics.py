"""Reliability of every pose: tests, controllability, what would stay undetected.

With whitened rows A = [A_z, A_p] of a pose, and Y = A T^-1 for the triangle T of the
whole system, the pose's block of the projector on residuals is M = I - Y Y^T. Then

    statistic       v^T M^+ v, chi-square with rank(M) degrees of freedom
    controllability trace(M) / n_rows, the redundancy numbers' mean
    detectable      delta_0 / sqrt(smallest eigenvalue of L^-T M L^-1) [mm]

Where an orientation was measured the pose has six rows, and both parts are also tested
alone: with L (M) L^T the dispersion of their residuals, each by its own block of it.

A pose that took no part in the adjustment has M = I + Y Y^T instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.lab.adjustment.equations import Station, WhiteRows
from traverse.lab.adjustment.noise import VarianceSums
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.problem import Network, State
from traverse.lab.adjustment.system import Elimination, System
from traverse.lab.statistics.distributions import (
    equivalent_normal,
    median_of_chi_square,
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
    variances: VarianceSums

    def fill(self, others: "PoseStatistics", poses: Booleans) -> None:
        """Take the entries of some poses (n_poses,) from others; not the sums."""
        for field in fields(self):
            if field.name != "variances":
                entries = getattr(self, field.name)
                entries[poses] = getattr(others, field.name)[poses]

    @property
    def robust_scale(self) -> float:
        """Estimate sigma0 from the medians of the statistics of each kind of pose."""
        squares, weights = [], []
        for degrees in range(1, 7):
            mine = self.degrees == degrees
            if np.count_nonzero(mine) >= 5:
                median = float(np.median(self.statistics[mine]))
                squares.append(median / median_of_chi_square(degrees))
                weights.append(np.count_nonzero(mine) * degrees)
        if not squares:
            return 1.0
        return float(np.sqrt(np.average(squares, weights=weights)))


def pose_statistics(
    network: Network,
    state: State,
    system: System,
    inverse: Floats,
    outsiders: Sequence[Station] | None = None,
) -> PoseStatistics:
    """Compute the statistics of all poses that took part.

    Or of outsiders: poses that took no part, at the same artefacts. The inverse is G
    with cofactors G G^T of the free parameters.
    """
    sign = -1.0 if outsiders is None else 1.0
    statistics = _empty(network)
    places = {station.index: place for place, station in enumerate(network.stations)}
    for station in network.stations if outsiders is None else outsiders:
        place = places.get(station.index)
        if place is None:
            continue
        elimination = system.eliminations[place]
        unknowns = state.unknowns[place]
        arm = state.arm
        # Outsiders have no corrections: they are tested as they were read.
        corrections = state.corrections[place] if outsiders is None else None
        for rows in network.white_rows(station, arm, unknowns, corrections):
            block = _blocks(rows, elimination, inverse, sign)
            poses = station.poses[rows.part]
            corrections = np.einsum("nij,ni->nj", rows.by_readings, rows.misclosures)
            statistics.corrections_rad[poses] = -corrections * network.noise.encoder_rad
            _add_tests(statistics, poses, rows, block)
            _add_variances(statistics.variances, station.index, rows, block)
    return statistics


def _blocks(
    rows: WhiteRows, elimination: Elimination, inverse: Floats, sign: float
) -> Floats:
    """Compute I + sign Y Y^T of every pose, (n_poses, n_rows, n_rows)."""
    of_unknowns = rows.by_unknowns @ elimination.gain
    arm = (rows.by_parameters - of_unknowns @ elimination.left) @ inverse
    by_own, by_arm = of_unknowns @ of_unknowns.swapaxes(1, 2), arm @ arm.swapaxes(1, 2)
    return np.eye(by_own.shape[1]) + sign * (by_own + by_arm)


def _add_tests(
    statistics: PoseStatistics,
    poses: Integers,
    rows: WhiteRows,
    block: Floats,
) -> None:
    n_rows = rows.misclosures.shape[1]
    values, vectors = np.linalg.eigh(block)
    good = values > _UNCONTROLLED
    along = np.einsum("nij,ni->nj", vectors, rows.misclosures)
    safe = np.where(good, values, 1.0)
    statistics.statistics[poses] = np.sum(np.where(good, along**2 / safe, 0.0), axis=1)
    statistics.degrees[poses] = np.count_nonzero(good, axis=1)
    statistics.w[poses] = equivalent_normal(
        statistics.statistics[poses], statistics.degrees[poses]
    )
    statistics.controllability[poses] = np.clip(np.mean(values, axis=1), 0.0, 1.0)
    statistics.misclosures_mm[poses, : min(n_rows, 3)] = rows.misclosures_mm
    by_contact = rows.whiteners[:, :, :3]
    in_mm = by_contact.swapaxes(1, 2) @ block @ by_contact
    smallest = np.linalg.eigvalsh(in_mm)[:, 0]
    floor = _UNCONTROLLED * np.einsum("nij,nij->n", by_contact, by_contact)
    statistics.detectable_mm[poses] = DETECTABLE / np.sqrt(np.maximum(smallest, floor))
    if n_rows > 3:
        _add_parts(statistics, poses, rows, block)


def _add_parts(
    statistics: PoseStatistics, poses: Integers, rows: WhiteRows, block: Floats
) -> None:
    """Test position and orientation each by itself."""
    lower = np.linalg.inv(rows.whiteners)
    dispersion = lower @ block @ lower.swapaxes(1, 2)
    misclosures = (lower @ rows.misclosures[:, :, np.newaxis])[:, :, 0]
    for entries, part in (
        (statistics.w_position, slice(0, 3)),
        (statistics.w_orientation, slice(3, 6)),
    ):
        # In units of its own noise, so that millimetres and radians are alike.
        dispersion_of_noise = lower[:, part] @ lower[:, part].swapaxes(1, 2)
        white = np.linalg.inv(np.linalg.cholesky(dispersion_of_noise))
        values, vectors = np.linalg.eigh(
            white @ dispersion[:, part, part] @ white.swapaxes(1, 2)
        )
        good = values > _UNCONTROLLED
        seen = (white @ misclosures[:, part, np.newaxis])[:, :, 0]
        along = np.einsum("nij,ni->nj", vectors, seen)
        squares = np.where(good, along**2 / np.where(good, values, 1.0), 0.0)
        degrees = np.count_nonzero(good, axis=1).astype(np.float64)
        entries[poses] = equivalent_normal(np.sum(squares, axis=1), degrees)
    statistics.orientation_errors_rad[poses] = rows.unweighted[:, 3:]


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
    for index, part in enumerate((slice(0, 3), slice(3, 6))):
        sums.of_parts[0, index] += np.sum(rows.misclosures[:, part] ** 2)
        sums.of_parts[1, index] += np.sum(np.einsum("nii->ni", block)[:, part])


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


# Of an artefact whose poses alone place it.
_PLACING_STEPS = 8


def predicted(
    network: Network, state: State, system: System, inverse: Floats, poses: Booleans
) -> PoseStatistics:
    """Test poses that took no part, one by one, with the predictive covariance.

    An artefact of which no pose took part is placed by its poses here: its
    unknowns are projected out, and the degrees of freedom that are left are shared
    equally among its equations. NaN for all other poses.
    """
    chosen = network.stations_of(poses)
    statistics = pose_statistics(network, state, system, inverse, chosen)
    known = {station.index for station in network.stations}
    for station in chosen:
        if station.index not in known:
            _add_unseen(statistics, network, state.arm, inverse, station)
    return statistics


def _add_unseen(
    statistics: PoseStatistics,
    network: Network,
    arm: ArmValues,
    inverse: Floats,
    station: Station,
) -> None:
    """Fill in the statistics of an artefact that was held out whole."""
    centres_mm = network.centres_mm(station, arm)
    unknowns = station.artefact.start(centres_mm, station.touches)
    for _ in range(_PLACING_STEPS):
        white, by_unknowns, _ = _predictive(network, arm, inverse, station, unknowns)
        step = np.linalg.lstsq(by_unknowns * station.scales, -white, rcond=1e-9)[0]
        unknowns = station.artefact.moved(unknowns, station.scales * step)
    white, by_unknowns, of_pose = _predictive(network, arm, inverse, station, unknowns)
    left, values, _ = np.linalg.svd(by_unknowns * station.scales, full_matrices=False)
    basis = left[:, values > 1e-9 * values[0]]
    residuals = white - basis @ (basis.T @ white)
    share = 1.0 - basis.shape[1] / len(white)
    squares = residuals[: len(of_pose)] ** 2
    mine = station.poses
    n_rows = np.bincount(of_pose).astype(np.float64)
    statistics.statistics[mine] = np.bincount(of_pose, weights=squares)
    statistics.degrees[mine] = n_rows * share
    # Like a chi-square of as many degrees as there are equations.
    size = statistics.statistics[mine] / max(share, 1e-12)
    statistics.w[mine] = equivalent_normal(size, n_rows)
    for rows in network.white_rows(station, arm, unknowns):
        n_mm = rows.misclosures_mm.shape[1]
        statistics.misclosures_mm[mine[rows.part], :n_mm] = rows.misclosures_mm
        if rows.by_turn is not None:
            statistics.orientation_errors_rad[mine[rows.part]] = rows.unweighted[:, 3:]


def _predictive(
    network: Network,
    arm: ArmValues,
    inverse: Floats,
    station: Station,
    unknowns: Floats,
) -> tuple[Floats, Floats, Integers]:
    """Whiten a station's equations and certificates by I + Y Y^T of the arm.

    Misclosures, (n,), how they change with the unknowns, (n, n_unknowns), and which of
    the station's poses the first of them are of, (n_equations,).
    """
    certificates = network.certified(station, arm, unknowns)
    n_unknowns = len(station.scales)
    white, by_unknowns, by_arm, of_pose = [], [], [], []
    for rows in network.white_rows(station, arm, unknowns):
        numbers = np.arange(len(station.poses))[rows.part]
        of_pose.append(np.repeat(numbers, rows.misclosures.shape[1]))
        white.append(rows.misclosures.ravel())
        by_unknowns.append(rows.by_unknowns.reshape(-1, n_unknowns))
        by_arm.append(rows.by_parameters.reshape(len(white[-1]), -1))
    white.append(-certificates[:, -1])
    by_unknowns.append(certificates[:, :n_unknowns])
    by_arm.append(certificates[:, n_unknowns:-1])
    moved = np.concatenate(by_arm) @ inverse
    lower = np.linalg.cholesky(np.eye(len(moved)) + moved @ moved.T)
    joined = np.column_stack([np.concatenate(white), np.concatenate(by_unknowns)])
    solved = np.linalg.solve(lower, joined)
    return solved[:, 0], solved[:, 1:], np.concatenate(of_pose)
