"""What a fit says about poses that took no part in it."""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.identification.equations.datum import scale_direction
from traverse.lab.identification.equations.network import Station, has_length, stations
from traverse.lab.identification.equations.noise import Noise
from traverse.lab.identification.equations.station_equations import (
    station_centres,
    white_rows,
)
from traverse.lab.identification.solve.adjustment import Adjustment
from traverse.lab.identification.solve.pose_statistics import (
    PoseStatistics,
    statistics_of_excluded,
)
from traverse.lab.identification.solve.rank import split
from traverse.lab.identification.solve.system import certified, linearise
from traverse.lab.statistics.distributions import equivalent_normal

_STEPS = 8


def with_noise(adjustment: Adjustment, noise: Noise) -> Adjustment:
    """Weigh a fit with another noise; the estimates stay as they are."""
    state, network = adjustment.state, replace(adjustment.network, noise=noise)
    parameters = network.parameters
    system = linearise(network, state)
    scale = np.empty((0, parameters.n_free))
    if not has_length(network):
        scale = scale_direction(parameters, state.arm.geometry)
    n_determined = adjustment.split.n_determined
    parts = split(system.upper, parameters.free_tolerances, scale, n_determined)
    return replace(adjustment, network=network, system=system, split=parts)


def predicted(
    adjustment: Adjustment, poses: Booleans, radius_mm: float
) -> PoseStatistics:
    """Test poses that took no part, one by one, with the predictive covariance.

    An artefact of which no pose took part stands where its poses here put it: its
    unknowns are projected out, and the degrees of freedom that are left are shared
    equally among its equations.

    Args:
        adjustment: The fit.
        poses: Which of the campaign's poses, (n_poses,).
        radius_mm: Of the probe's ball.

    Returns:
        With NaN for all other poses.
    """
    chosen = stations(adjustment.network.campaign, radius_mm, poses)
    found = statistics_of_excluded(adjustment, chosen)
    known = {station.index for station in adjustment.network.stations}
    for station in chosen:
        if station.index not in known:
            _add_unseen(found, adjustment, station)
    return found


def _add_unseen(
    found: PoseStatistics, adjustment: Adjustment, station: Station
) -> None:
    """Fill in the statistics of an artefact that was held out whole."""
    network, arm = adjustment.network, adjustment.state.arm
    centres_mm = station_centres(network, station, arm)
    unknowns = station.artefact.start(centres_mm, station.touches)
    n_rows = station.artefact.rows_per_pose
    for _ in range(_STEPS):
        white, own = _predictive(adjustment, station, unknowns)
        step = np.linalg.lstsq(own * station.scales, -white, rcond=1e-9)[0]
        unknowns = station.artefact.moved(unknowns, station.scales * step)
    white, own = _predictive(adjustment, station, unknowns)
    left, values, _ = np.linalg.svd(own * station.scales, full_matrices=False)
    basis = left[:, values > 1e-9 * values[0]]
    residuals = white - basis @ (basis.T @ white)
    share = 1.0 - basis.shape[1] / len(white)
    squares = residuals[: n_rows * len(station.poses)].reshape(-1, n_rows) ** 2
    mine = station.poses
    found.statistics[mine] = np.sum(squares, axis=1)
    found.degrees[mine] = n_rows * share
    # Like a chi-square of as many degrees as there are equations.
    size = found.statistics[mine] / max(share, 1e-12)
    found.w[mine] = equivalent_normal(size, np.full(len(mine), float(n_rows)))
    for rows in white_rows(network, station, arm, unknowns):
        found.misclosures_mm[mine[rows.part], :n_rows] = rows.misclosures_mm


def _predictive(
    adjustment: Adjustment, station: Station, unknowns: Floats
) -> tuple[Floats, Floats]:
    """Whiten a station's equations and certificates by I + Y Y^T of the arm.

    Returns:
        Misclosures, (n,), and how they change with the unknowns, (n, n_unknowns).
    """
    network, arm = adjustment.network, adjustment.state.arm
    certificates = certified(network, station, arm, unknowns)
    n_unknowns = len(station.scales)
    white, own, by_arm = [], [], []
    for rows in white_rows(network, station, arm, unknowns):
        white.append(rows.misclosures.ravel())
        own.append(rows.by_unknowns.reshape(-1, n_unknowns))
        by_arm.append(rows.by_parameters.reshape(len(white[-1]), -1))
    white.append(-certificates[:, -1])
    own.append(certificates[:, :n_unknowns])
    by_arm.append(certificates[:, n_unknowns:-1])
    moved = np.concatenate(by_arm) @ adjustment.split.inverse
    lower = np.linalg.cholesky(np.eye(len(moved)) + moved @ moved.T)
    joined = np.column_stack([np.concatenate(white), np.concatenate(own)])
    solved = np.linalg.solve(lower, joined)
    return solved[:, 0], solved[:, 1:]
