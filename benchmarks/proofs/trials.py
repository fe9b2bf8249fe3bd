"""One simulated campaign identified and judged by the truth.

The distance of the ball between two postures does not depend on the place of the base
nor on how parameters share a shift; any correct identification must predict it.
Estimates are compared with the simulator's own matrices, whitened with the covariance
that the identification states; derivatives of distances are differences of distances,
not the adjustment's own.
"""

from dataclasses import asdict, dataclass, replace
from functools import lru_cache

import numpy as np

from benchmarks.proofs.conditions import mix_poses
from benchmarks.tools.handover import campaign_from_simulation
from benchmarks.trials.lines import Line
from traverse.arrays import Floats
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.adjustment.equations import Station, WhiteRows
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.result import Identification
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.campaigns import PoseSet, SimulatedCampaign, draw_noise
from traverse.simulator.campaigns.spec import NoiseTable

# More than there are parameters, so that every combination of them is looked at.
N_PAIRS = 60
_DIFFERENCE = 1e-3  # of a parameter's plausible deviation
_NEAREST_MM = 100.0
_LEAST_SIZE = 1e-7  # of the largest: smaller ones are rounding


@dataclass(frozen=True, slots=True, eq=False)
class DistanceErrors:
    """Predicted less true distances.

    Attributes:
        errors_mm: (n_pairs,); without a length, of distances in units of their mean.
        chi_square: Of the errors, whitened by the stated cofactors and sigma0 = 1.
        foreseen: Chi-square of the errors that follow from foreseen steps, or NaN.
    """

    errors_mm: Floats
    chi_square: float
    degrees: int
    foreseen: float


def distance_errors(
    result: Identification,
    poses: PoseSet,
    seed: int,
    *,
    has_scale: bool = True,
    steps: Floats | None = None,
) -> DistanceErrors:
    """Compare predicted distances between random posture pairs with the truth.

    Args:
        result: The identification.
        poses: Where the true arm and its limits are.
        seed: Of the posture pairs.
        has_scale: Whether the campaign has a length; else shapes are compared.
        steps: By which the free parameters are foreseen to be off, (n_free,).
    """
    rng = np.random.default_rng([seed, 0x696E76])
    least, largest = poses.limits_rad.T
    turns_rad = rng.uniform(least, largest, (4 * N_PAIRS, len(least)))
    # The direction of a short distance, and so its error, is not linear in the steps.
    apart_mm = _distances(probe_pose(poses.truth.mechanism, turns_rad)[0])
    far = np.flatnonzero(apart_mm >= _NEAREST_MM)[:N_PAIRS]
    turns_rad = turns_rad.reshape(-1, 2, len(least))[far].reshape(-1, len(least))
    angles_rad = poses.faulty.build.encoders_of(turns_rad) + poses.truth.zeros_rad
    true_mm = _distances(probe_pose(poses.truth.mechanism, turns_rad)[0])
    adjustment = result.adjustment
    parameters, estimate = adjustment.network.parameters, adjustment.state.arm

    def predicted_mm(values: ArmValues) -> Floats:
        return _distances(probe_centre(values.geometry, angles_rad))

    slopes = np.empty((N_PAIRS, parameters.n_free))
    for number, tolerance in enumerate(parameters.free_tolerances):
        step = np.zeros(parameters.n_free)
        step[number] = _DIFFERENCE * tolerance
        ahead = predicted_mm(parameters.moved(estimate, step))
        behind = predicted_mm(parameters.moved(estimate, -step))
        slopes[:, number] = (ahead - behind) / (2.0 * step[number])
    found_mm = predicted_mm(estimate)
    errors_mm = found_mm - true_mm
    if not has_scale:
        mean_mm = float(true_mm.mean())
        errors_mm = mean_mm * (np.log(found_mm) - np.log(true_mm))
        slopes = mean_mm * slopes / found_mm[:, np.newaxis]
        errors_mm = errors_mm - errors_mm.mean()
        slopes = slopes - slopes.mean(axis=0)
    spread = slopes @ adjustment.split.inverse
    left, sizes, _ = np.linalg.svd(spread, full_matrices=False)
    is_determined = sizes > _LEAST_SIZE * np.max(sizes, initial=0.0)
    white = (left.T @ errors_mm)[is_determined] / sizes[is_determined]
    foreseen = np.nan
    if steps is not None:
        expected = (left.T @ (slopes @ steps))[is_determined] / sizes[is_determined]
        foreseen = float(expected @ expected)
    return DistanceErrors(errors_mm, float(white @ white), len(white), foreseen)


def _distances(centres_mm: Floats) -> Floats:
    """Distances of consecutive pairs, (n / 2,)."""
    distances: Floats = np.linalg.norm(centres_mm[::2] - centres_mm[1::2], axis=1)
    return distances


# Below this part of the largest, a singular value of scaled columns is zero.
_RANK = 1e-9
_LENGTHS = ("distance_mm", "radius_mm")
_SILENCE = NoiseTable(encoder_rad=0.0, contact_mm=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Foreseen:
    """Expected result of a campaign.

    Attributes:
        sum_of_squares: Weighted.
        steps: By which free parameters are off, (n_free,).
    """

    sum_of_squares: float
    steps: Floats


class PlantedNoise:
    """The equations of a set of poses at the truth.

    Attributes:
        redundancy: Equations and certificates less the rank of their unknowns.
    """

    def __init__(self, poses: PoseSet, noise: NoiseTable) -> None:
        campaign = _without_errors(poses, noise)
        options = Options(n_suggestions=0, snooping=False)
        adjustment = identify(campaign, poses.arm, options).adjustment
        self._network, self._state = adjustment.network, adjustment.state
        self._rows: list[list[WhiteRows]] = []
        blocks = []
        start, width = 0, sum(len(s.scales) for s in self._network.stations)
        for station, unknowns in zip(
            self._network.stations, self._state.unknowns, strict=True
        ):
            rows = list(self._network.white_rows(station, self._state.arm, unknowns))
            self._rows.append(rows)
            places = slice(start, start + len(station.scales))
            blocks += [
                _wide(r.by_unknowns, r.by_parameters, places, width) for r in rows
            ]
            certified = self._network.certified(station, self._state.arm, unknowns)
            n_own = len(station.scales)
            blocks.append(
                _wide(certified[:, :n_own], certified[:, n_own:-1], places, width)
            )
            start += n_own
        columns = np.vstack(blocks)
        sizes = np.linalg.norm(columns, axis=0)
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        left, values, right = np.linalg.svd(columns / sizes, full_matrices=False)
        is_determined = values > _RANK * values[0]
        self._explained = left[:, is_determined]
        self._to_steps = (
            right[is_determined].T / values[is_determined] / sizes[:, np.newaxis]
        )[width:]
        self.redundancy = int(np.subtract(*self._explained.shape))

    def foreseen(self, drawn: SimulatedCampaign) -> Foreseen:
        """Predict the result of a campaign with these poses.

        Where there is no length, steps change the scale too, as happens to be least.
        """
        campaign = campaign_from_simulation(drawn.campaign)
        errors = np.concatenate(
            [
                self._errors(number, station, drawn, campaign)
                for number, station in enumerate(self._network.stations)
            ]
        )
        explained = errors @ self._explained
        return Foreseen(
            float(errors @ errors - explained @ explained),
            -self._to_steps @ explained,
        )

    def _errors(
        self,
        number: int,
        station: Station,
        drawn: SimulatedCampaign,
        campaign: Campaign,
    ) -> Floats:
        """Whitened errors of a station's touches, then of its certificate."""
        by_reading = drawn.truth.encoder_noise_rad / self._network.noise.encoder_rad
        errors = []
        for rows in self._rows[number]:
            poses = station.poses[rows.part]
            of_readings = np.einsum("nij,nj->ni", rows.by_readings, by_reading[poses])
            shifts_mm = drawn.truth.contact_noise_mm[poses]
            of_contacts = np.einsum("nij,nj->ni", rows.by_centre, shifts_mm)
            errors.append((of_readings + of_contacts).ravel())
        # Lengths as they are, less what the campaign says of them.
        certificate = campaign.artefacts[station.index].certificate(
            self._state.unknowns[number], station.touches
        )
        return np.concatenate(
            [*errors, certificate.misclosures_mm / certificate.std_mm]
        )


def _without_errors(poses: PoseSet, noise: NoiseTable) -> Campaign:
    """Make the campaign of readings and certificates that are right."""
    campaign = campaign_from_simulation(draw_noise(poses, 0, _SILENCE).campaign)
    artefacts = []
    for artefact, placed in zip(campaign.artefacts, poses.artefacts, strict=True):
        true_mm = {
            key: getattr(placed.artefact, key)
            for key in _LENGTHS
            if getattr(artefact, key, None) is not None
        }
        artefacts.append(artefact.model_copy(update=true_mm))
    return replace(
        campaign,
        artefacts=tuple(artefacts),
        encoder_rad=noise.encoder_rad,
        contact_mm=noise.contact_mm,
    )


def _wide(
    by_unknowns: Floats, by_parameters: Floats, columns: slice, width: int
) -> Floats:
    """Put derivatives of one station into columns of all unknowns."""
    n_free = by_parameters.shape[-1]
    rows = np.zeros((by_parameters.size // n_free, width + n_free))
    rows[:, columns] = by_unknowns.reshape(len(rows), columns.stop - columns.start)
    rows[:, width:] = by_parameters.reshape(len(rows), n_free)
    return rows


# Poses of a campaign. "everything" has 15 artefacts: with fewer than 40 poses each
# a sphere of a bar hardly controls its own contacts.
MIXES = {
    "cones": 300,
    "cones+bar": 300,
    "bars": 300,
    "sphere-known": 300,
    "planes+length": 300,
    "points-arm": 300,
    "everything": 600,
}
_NOISE_SEEDS = 100_000
PER_POSE_SET = 10
WITHOUT_LENGTH = frozenset({"cones"})


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One campaign.

    Attributes:
        poses: Where it was measured, and the truth.
        planted: The equations there, at the truth.
    """

    mix: str
    seed: int
    poses: PoseSet
    planted: PlantedNoise
    simulated: SimulatedCampaign


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one campaign.

    Attributes:
        passed: the global test of sigma0.
        sum_of_squares: weighted, of the last adjustment.
        foreseen: sum of squares by the planted errors, if all poses take part without
            blunders; else None.
        foreseen_chi_square: by the planted errors; else None.
        n_determined: directions of the arm's parameters.
        n_lost: good poses that were removed.
    """

    converged: bool
    passed: bool
    sum_of_squares: float
    redundancy: int
    foreseen: float | None
    foreseen_redundancy: int
    chi_square: float
    foreseen_chi_square: float | None
    degrees: int
    mean_square_mm2: float
    n_determined: int
    n_blunders: int
    n_kept: int
    n_lost: int


def draw(mix: str, blunder_share: float, seed: int) -> Case:
    """Draw a campaign; ten have the same poses, and no two mixes the same noise."""
    noise = NoiseTable(blunder_share=blunder_share)
    poses, planted = _planted(mix, seed // PER_POSE_SET + 1)
    of_noise = _NOISE_SEEDS * list(MIXES).index(mix) + seed
    return Case(mix, of_noise, poses, planted, draw_noise(poses, of_noise, noise))


@lru_cache(maxsize=2)
def _planted(mix: str, pose_seed: int) -> tuple[PoseSet, PlantedNoise]:
    poses = mix_poses(mix, MIXES[mix], pose_seed)
    return poses, PlantedNoise(poses, NoiseTable())


def run(case: Case) -> Line:
    """Identify a campaign and judge it by the truth."""
    poses, simulated = case.poses, case.simulated
    campaign = campaign_from_simulation(simulated.campaign)
    result = identify(campaign, poses.arm, Options(n_suggestions=0))
    spoilt = np.zeros(poses.n_poses, dtype=np.bool_)
    spoilt[[blunder.row for blunder in simulated.truth.blunders]] = True
    kept = spoilt & result.included
    is_whole = bool(np.all(result.included)) and not np.any(spoilt)
    foreseen = case.planted.foreseen(simulated) if is_whole else None
    errors = distance_errors(
        result,
        poses,
        case.seed,
        has_scale=case.mix not in WITHOUT_LENGTH,
        steps=None if foreseen is None else foreseen.steps,
    )
    outcome = Outcome(
        converged=result.converged,
        passed=bool(result.global_test.passed),
        sum_of_squares=result.adjustment.system.sum_of_squares,
        redundancy=result.redundancy,
        foreseen=None if foreseen is None else foreseen.sum_of_squares,
        foreseen_redundancy=case.planted.redundancy,
        chi_square=errors.chi_square,
        foreseen_chi_square=None if foreseen is None else errors.foreseen,
        degrees=errors.degrees,
        mean_square_mm2=float(np.mean(errors.errors_mm**2)),
        n_determined=result.adjustment.split.n_determined,
        n_blunders=int(np.count_nonzero(spoilt)),
        n_kept=int(np.count_nonzero(kept)),
        n_lost=int(np.count_nonzero(~result.included & ~spoilt)),
    )
    return {"outcome": asdict(outcome)}
