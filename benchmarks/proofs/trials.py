"""One simulated campaign identified and judged by the truth."""

from dataclasses import dataclass

import numpy as np

from benchmarks.proofs.campaigns import mix_poses
from benchmarks.proofs.invariants import distance_errors
from benchmarks.proofs.planted import PlantedNoise
from benchmarks.tools.handover import campaign_from_simulation
from traverse.lab.identification.identify import Options, identify
from traverse.simulator.campaigns import draw_noise
from traverse.simulator.campaigns.spec import NoiseTable

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
WITHOUT_LENGTH = frozenset({"cones"})


@dataclass(frozen=True, slots=True)
class Task:
    """Campaigns of one set of poses.

    Attributes:
        mix: Of artefacts.
        pose_seed: Of the true arm, the artefacts' places and the postures.
        noise_seeds: One campaign each.
        blunder_share: Part of the poses that are spoilt.
    """

    mix: str
    pose_seed: int
    noise_seeds: tuple[int, ...]
    blunder_share: float = 0.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one campaign.

    Attributes:
        converged: Whether the last adjustment converged.
        passed: The global test of sigma0.
        sum_of_squares: Weighted, of the last adjustment.
        redundancy: Of that.
        foreseen: Sum of squares that the planted errors must leave, for poses that
            all take part without blunders; else NaN.
        foreseen_redundancy: Of that.
        chi_square: Of invariant distances.
        foreseen_chi_square: That which follows from the planted errors; else NaN.
        degrees: Of that.
        mean_square_mm2: Of the distances' errors.
        n_determined: Directions of the arm's parameters.
        tells_no_length: Among what is undetermined there is the scale.
        n_undetermined: Directions held at the design.
        n_blunders: Spoilt poses.
        n_kept: Spoilt poses that were not removed.
        kept_w: Largest |w| of those against the others, 0 without any.
        n_lost: Good poses that were removed.
    """

    converged: bool
    passed: bool
    sum_of_squares: float
    redundancy: int
    foreseen: float
    foreseen_redundancy: int
    chi_square: float
    foreseen_chi_square: float
    degrees: int
    mean_square_mm2: float
    n_determined: int
    tells_no_length: bool
    n_undetermined: int
    n_blunders: int
    n_kept: int
    kept_w: float
    n_lost: int


def outcomes(task: Task) -> tuple[Outcome, ...]:
    """Draw, identify and judge the campaigns of a task."""
    poses = mix_poses(task.mix, MIXES[task.mix], task.pose_seed)
    noise = NoiseTable(blunder_share=task.blunder_share)
    options = Options(n_suggestions=0)
    planted = PlantedNoise(poses, noise)
    found = []
    for seed in task.noise_seeds:
        simulated = draw_noise(poses, seed, noise)
        result = identify(
            campaign_from_simulation(simulated.campaign), poses.arm, options
        )
        spoilt = np.zeros(poses.n_poses, dtype=np.bool_)
        spoilt[[blunder.row for blunder in simulated.truth.blunders]] = True
        kept = spoilt & result.included
        is_whole = bool(np.all(result.included)) and not np.any(spoilt)
        foreseen = planted.foreseen(simulated) if is_whole else None
        errors = distance_errors(
            result,
            poses,
            seed,
            has_scale=task.mix not in WITHOUT_LENGTH,
            steps=None if foreseen is None else foreseen.steps,
        )
        found.append(
            Outcome(
                converged=result.converged,
                passed=result.global_test.passed,
                sum_of_squares=result.adjustment.system.sum_of_squares,
                redundancy=result.redundancy,
                foreseen=np.nan if foreseen is None else foreseen.sum_of_squares,
                foreseen_redundancy=planted.redundancy,
                chi_square=errors.chi_square,
                foreseen_chi_square=errors.foreseen,
                degrees=errors.degrees,
                mean_square_mm2=float(np.mean(errors.errors_mm**2)),
                n_determined=result.adjustment.split.n_determined,
                tells_no_length=any("length" in u.why for u in result.undetermined),
                n_undetermined=len(result.undetermined),
                n_blunders=int(np.count_nonzero(spoilt)),
                n_kept=int(np.count_nonzero(kept)),
                kept_w=float(np.max(result.statistics.w[kept], initial=0.0)),
                n_lost=int(np.count_nonzero(~result.included & ~spoilt)),
            )
        )
    return tuple(found)


def tasks(
    mix: str, seeds: range, per_pose_set: int, blunder_share: float = 0.0
) -> list[Task]:
    """Share campaigns out over sets of poses; no two mixes have the same noise."""
    offset = _NOISE_SEEDS * list(MIXES).index(mix)
    return [
        Task(
            mix,
            pose_seed=seeds[first] // per_pose_set + 1,
            noise_seeds=tuple(
                offset + seed for seed in seeds[first : first + per_pose_set]
            ),
            blunder_share=blunder_share,
        )
        for first in range(0, len(seeds), per_pose_set)
    ]
