"""What a family teaches about one more of its arms, by hidden effects.

python -m benchmarks.fleet.family [--rounds N] [--poses N] [--scheduler ADDRESS]

Forty simulated arms of a design are identified. New arms of the family have short
campaigns with one hidden effect, or none; each is diagnosed by its poses alone and with
the family. Strangers are arms that differ from the family ten times as much as its own.
Sizes are sqrt(lambda): of the best test of the effect, in standard deviations, with the
family.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.detectable_sizes import noise_free_campaign, ruler
from benchmarks.blind.hidden.effects import EFFECT_KINDS
from benchmarks.blind.hidden.poses import (
    NEEDS_TWO_LENGTHS,
    START,
    drawn,
    played,
    weighed,
)
from benchmarks.blind.round import truth_of
from benchmarks.blind.score import TrueTerm, scored
from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.handover import campaign_from_simulation
from benchmarks.tools.workers import add_workers, ordered, unordered
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.prior import Prior
from traverse.lab.diagnosis.advice.minimal_detectable import planned
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.holdout.holdout import split
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.identification.family import LEVEL, population_of
from traverse.lab.identification.identify import IdentificationError, identify
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    ConditionTable,
    Cone,
    NoiseTable,
    PoseSet,
    Sphere,
    draw_noise,
    make_poses,
    true_arm_file,
)

N_ARMS = 40
WHOLE_CAMPAIGN = 480
SIZES = (5.0, 7.0, 10.0, 14.0, 20.0)
_OFFSETS = Deviations(links_mm=0.5, axes_rad=2e-3, zeros_rad=2e-3)
SPREAD = Deviations(links_mm=0.03, axes_rad=1e-4, zeros_rad=1e-4)
_STRANGE = Deviations(links_mm=0.3, axes_rad=1e-3, zeros_rad=1e-3)
_FAMILY_SEED, _FIRST_SEED = 7, 1000


@dataclass(frozen=True, slots=True)
class Trial:
    """One more arm: poses of its campaign, size of its effect, whether a stranger."""

    seed: int
    n_poses: int
    prior: Prior
    size: float = 0.0
    is_strange: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """What came of a trial: alone, then with the family."""

    trial: Trial
    kind: str
    alone: "Judged"
    with_family: "Judged"


@dataclass(frozen=True, slots=True)
class Judged:
    """What a diagnosis said, and in how many parameters the arm left its family."""

    detected: bool
    exact: bool
    wrong: bool
    n_left: int


def design_of() -> Arm:
    """Take the arm of the demonstration, with masses."""
    return weighed(demo_arm())


def poses_of(seed: int, n_poses: int, deviations: Deviations) -> PoseSet:
    """Make contacts of an arm that differs so much from what its family has."""
    design = design_of()
    typical = true_arm_file(design, true_arm(design, _OFFSETS, _FAMILY_SEED))
    spec = CampaignSpec(
        artefacts=(
            *(Cone(id=f"cone-{k}", n_poses=n_poses // 6) for k in range(3)),
            Sphere(id="sphere", n_poses=n_poses // 6, radius_mm=25.0),
            BallBar(
                id="bar",
                n_poses=n_poses // 3,
                radius_mm=12.7,
                distance_mm=500.0,
                distance_std_mm=5e-4,
            ),
        ),
        noise=NoiseTable(encoder_rad=5e-6, contact_mm=0.003),
        conditions=ConditionTable(swing_c=2.0, speed_rad_s=0.3, start_utc=START),
    )
    return make_poses(design, spec, seed, true_arm(typical, deviations, seed))


def identified(seed: int) -> tuple[tuple[str, ...], list[float], list[float]]:
    """Identify an arm of the family: names, values, standard deviations."""
    poses = poses_of(seed, WHOLE_CAMPAIGN, SPREAD)
    campaign = campaign_from_simulation(draw_noise(poses, seed).campaign)
    found = identify(campaign, design_of()).parameters
    names = tuple(one.name for one in found)
    return names, [one.value for one in found], [one.std for one in found]


def prior_of(scheduler: str | None) -> Prior:
    """Learn the family from forty arms."""
    rows = ordered(scheduler, identified, range(N_ARMS))
    names = rows[0][0]
    values, stds = (np.array([row[part] for row in rows]) for part in (1, 2))
    populations = [
        population_of(values[:, k], stds[:, k], LEVEL / values.size)
        for k in range(len(names))
    ]
    means, of_one_more = (
        np.array([getattr(one, key) for one in populations]) for key in ("mean", "std")
    )
    return Prior("family", design_of(), N_ARMS, names, means, of_one_more, names)


def tried(trial: Trial) -> Found:
    """Hide, measure, diagnose twice."""
    deviations = _STRANGE if trial.is_strange else SPREAD
    poses = poses_of(trial.seed, trial.n_poses, deviations)
    kind, truths = "", tuple[TrueTerm, ...]()
    if trial.size:
        kind, poses, truth = _hidden(poses, trial)
        truths = (truth,)
    campaign = campaign_from_simulation(draw_noise(poses, trial.seed).campaign)
    alone = _judged(campaign, truths, trial)
    with_family = _judged(replace(campaign, prior=trial.prior), truths, trial)
    return Found(trial, kind, alone, with_family)


def _hidden(poses: PoseSet, trial: Trial) -> tuple[str, PoseSet, TrueTerm]:
    """Draw an effect that the campaign can show with the family, and play it."""
    rng = np.random.default_rng([trial.seed, 0xFA])
    choosing, _ = split(noise_free_campaign(poses), trial.seed)
    measure = ruler(poses, design_of(), choosing, trial.prior)
    kinds = [kind for kind in EFFECT_KINDS if kind != NEEDS_TWO_LENGTHS]
    while True:
        kind = str(rng.choice(kinds))
        one = measure.sized(drawn(rng, poses, kind), trial.size)
        if one is not None:
            return kind, played(poses, (one,)), truth_of(measure, one)


def _judged(campaign: Campaign, truths: tuple[TrueTerm, ...], trial: Trial) -> Judged:
    options = DiagnosisOptions(seed=trial.seed, details=False)
    try:
        found = diagnose(campaign, design_of(), options)
    except IdentificationError:  # too few poses
        return Judged(detected=False, exact=False, wrong=False, n_left=0)
    score = scored(truths, found)
    prior = found.campaign.prior
    n_left = 0 if prior is None else len(prior.contradicted)
    return Judged(score.detected, score.exact, score.confident_wrong, n_left)


def smallest_sizes(prior: Prior, n_poses: int) -> dict[str, float]:
    """Compare the smallest detectable sizes alone with those with the family."""
    poses = poses_of(_FIRST_SEED, n_poses, SPREAD)
    campaign = campaign_from_simulation(draw_noise(poses, _FIRST_SEED).campaign)
    alone, together = (
        {
            (one.candidate.identity, one.key): one.minimum
            for one in planned(replace(campaign, prior=known), design_of())
        }
        for known in (None, prior)
    )
    ratios = [
        least / other
        for least, other in ((least, together[key]) for key, least in alone.items())
        if least is not None and other is not None
    ]
    return {
        "effects": len(alone),
        "seen_alone": sum(one is not None for one in alone.values()),
        "seen_with_family": sum(one is not None for one in together.values()),
        "times_smaller": float(np.median(ratios)) if ratios else float("nan"),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet.family")
    parser.add_argument("--rounds", type=int, default=30, help="of each size")
    parser.add_argument("--poses", type=int, nargs="*", default=[36, 48])
    add_workers(parser)
    given = parser.parse_args(arguments)
    begun_s = time.monotonic()
    prior = prior_of(given.scheduler)
    print("| poses | effects seen alone | with the family | times smaller, median |")
    print("|---|---|---|---|")
    for n_poses in (24, 36, 48, 96, WHOLE_CAMPAIGN):
        found = smallest_sizes(prior, n_poses)
        print(
            f"| {n_poses} | {found['seen_alone']} of {found['effects']} | "
            f"{found['seen_with_family']} | {found['times_smaller']:.2f} |",
            flush=True,
        )
    print(
        "\n| poses | arms | n | found: alone, family | named | wrongly named | left |"
    )
    print("|---|---|---|---|---|---|---|")
    wanted = [
        *((f"effect of {size:.0f}", size, False) for size in SIZES),
        ("no effect", 0.0, False),
        ("stranger, no effect", 0.0, True),
    ]
    for n_poses in given.poses:
        for n_kind, (name, size, is_strange) in enumerate(wanted):
            seeds = range(_FIRST_SEED, _FIRST_SEED + given.rounds)
            trials = [
                Trial(100 * seed + n_kind, n_poses, prior, size, is_strange)
                for seed in seeds
            ]
            print(
                _row(name, list(unordered(given.scheduler, tried, trials))), flush=True
            )
    print(f"\ntook {time.monotonic() - begun_s:.0f} s")
    return 0


def _row(name: str, found: Sequence[Found]) -> str:
    n = len(found)
    columns = [
        f"{sum(getattr(one.alone, key) for one in found)}, "
        f"{sum(getattr(one.with_family, key) for one in found)}"
        for key in ("detected", "exact", "wrong")
    ]
    left = sum(one.with_family.n_left > 0 for one in found)
    shown = " | ".join(columns)
    return f"| {found[0].trial.n_poses} | {name} | {n} | {shown} | {left} |"


if __name__ == "__main__":
    sys.exit(main())
