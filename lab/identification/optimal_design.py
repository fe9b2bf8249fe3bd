"""Which poses would help most next (A-optimality).

Candidates are random postures that touch the campaign's artefacts where they are,
within the travel that the campaign itself has shown, found by the condition equations
themselves: minimum-norm steps of the joints until w = 0. Of these, greedily, the ones
that lower the mean variance of the probe over the travelled volume most.

With A the derivatives of w by the joints, a step is -A' (A A' + s I)^-1 w.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.adjustment import Adjustment, Network
from traverse.lab.artefacts.artefact import postures_touching
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.outcomes.identified import Suggestion

_N_SECTORS = 36
# Below this travel a joint is named as the cause of undetermined parameters.
_SMALL_TRAVEL_RAD = np.radians(20.0)


@dataclass(frozen=True, slots=True, eq=False)
class JointCoverage:
    """Where a joint has been.

    Attributes:
        sectors: Poses in each of 36 sectors of a turn, from reading 0 on, (36,).
    """

    joint: str
    least_rad: float
    largest_rad: float
    sectors: Integers

    @property
    def travel_rad(self) -> float:
        return self.largest_rad - self.least_rad

    @property
    def hardly_turned(self) -> bool:
        """Whether the first advice is to turn it further."""
        return bool(self.travel_rad < _SMALL_TRAVEL_RAD)

    @property
    def part_of_turn(self) -> float:
        """Sectors of the turn that have been visited, 0 to 1."""
        return float(np.count_nonzero(self.sectors)) / _N_SECTORS


def joint_coverage(campaign: Campaign, poses: Integers) -> tuple[JointCoverage, ...]:
    coverage = []
    for k, name in enumerate(campaign.joint_names):
        angles_rad = campaign.poses.angles_rad[poses, k]
        turns = np.mod(angles_rad / (2.0 * np.pi), 1.0)
        sectors = np.minimum((turns * _N_SECTORS).astype(np.int64), _N_SECTORS - 1)
        counts = np.bincount(sectors, minlength=_N_SECTORS)
        coverage.append(
            JointCoverage(
                name, float(angles_rad.min()), float(angles_rad.max()), counts
            )
        )
    return tuple(coverage)


_SEED = 3
_TRIES_AN_ARTEFACT = 60
_MOST_ARTEFACTS = 12
_WIDER_RAD = np.radians(30.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    station: int
    feature: int
    angles_rad: Floats
    rows: Floats


def most_helpful_poses(adjustment: Adjustment, n_wanted: int) -> tuple[Suggestion, ...]:
    """Suggest poses, the best first."""
    network = adjustment.network
    if n_wanted == 0:
        return ()
    candidates = _candidates(adjustment)
    covariance = _joint_covariance(adjustment)
    n_free = network.parameters.n_free
    columns, _ = network.posture_columns(adjustment.state.arm)
    metric = np.einsum("nip,niq->pq", columns, columns) / len(columns)
    start = float(np.sum(metric * covariance[:n_free, :n_free]))
    suggestions: list[Suggestion] = []
    while candidates and len(suggestions) < n_wanted and start > 0.0:
        gains = [_gain(c.rows, covariance, metric) for c in candidates]
        best = candidates.pop(int(np.argmax(gains)))
        cross = covariance @ best.rows.T
        square = np.eye(len(best.rows)) + best.rows @ cross
        covariance = covariance - cross @ np.linalg.solve(square, cross.T)
        left = float(np.sum(metric * covariance[:n_free, :n_free]))
        station = network.stations[best.station]
        feature = station.touches.feature_names[best.feature]
        suggestions.append(
            Suggestion(station.artefact.id, feature, best.angles_rad, left / start)
        )
    return tuple(suggestions)


def _gain(rows: Floats, covariance: Floats, metric: Floats) -> float:
    n_free = len(metric)
    cross = covariance @ rows.T
    inverse = np.linalg.inv(np.eye(len(rows)) + rows @ cross)
    arm = cross[:n_free]
    return float(np.sum((arm.T @ metric @ arm) * inverse))


def _joint_covariance(adjustment: Adjustment) -> Floats:
    """Put the arm's and the stations' cofactors into one matrix."""
    inverse = adjustment.split.inverse
    arm = inverse @ inverse.T
    chosen = adjustment.system.eliminations[:_MOST_ARTEFACTS]
    maps = [-elimination.gain @ elimination.left for elimination in chosen]
    full = np.vstack([np.eye(len(arm)), *maps])
    covariance: Floats = full @ arm @ full.T
    first = len(arm)
    for elimination in chosen:
        width = len(elimination.gain)
        of_station = slice(first, first + width)
        covariance[of_station, of_station] += elimination.gain @ elimination.gain.T
        first += width
    return covariance


def _travel(network: Network) -> Floats:
    """Return lower and upper limits of joints [rad], (2, n_joints).

    Their stops are unknown: visited postures are reachable. Only joints that
    hardly turned must turn more.
    """
    coverage = joint_coverage(network.campaign, network.poses)
    wider = np.array([_WIDER_RAD if joint.hardly_turned else 0.0 for joint in coverage])
    least = np.array([joint.least_rad for joint in coverage])
    largest = np.array([joint.largest_rad for joint in coverage])
    return np.stack([least - wider, largest + wider])


def _candidates(adjustment: Adjustment) -> list[_Candidate]:
    network, state = adjustment.network, adjustment.state
    rng = np.random.default_rng(_SEED)
    limits_rad = _travel(network)
    chosen = network.stations[:_MOST_ARTEFACTS]
    widths = [len(station.scales) for station in chosen]
    n_free = network.parameters.n_free
    offsets = n_free + np.concatenate([[0], np.cumsum(widths)])
    candidates = []
    for at, station in enumerate(chosen):
        size = _TRIES_AN_ARTEFACT, network.parameters.n_joints
        tries_rad = rng.uniform(limits_rad[0], limits_rad[1], size)
        like = rng.integers(len(station.poses), size=_TRIES_AN_ARTEFACT)
        touches = station.part(like).touches
        came = postures_touching(
            station.artefact,
            state.unknowns[at],
            touches,
            state.arm.geometry,
            tries_rad,
            limits_rad=limits_rad,
        )
        reached_rad = came.angles_rad
        rows = network.rows_at(at, state, reached_rad, touches)
        for index in np.flatnonzero(came.is_touching):
            full = np.zeros((rows.shape[1], int(offsets[-1])))
            full[:, :n_free] = rows[index, :, :n_free]
            full[:, offsets[at] : offsets[at + 1]] = rows[index, :, n_free:]
            candidates.append(
                _Candidate(at, int(touches.features[index]), reached_rad[index], full)
            )
    return candidates
