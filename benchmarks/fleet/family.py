"""Gain of a family's prior for one more of its arms, by hidden effects.

python -m benchmarks.fleet.family [--seeds N] [--poses N] [--scheduler ADDRESS]

Forty simulated arms of a design are identified. New arms of the family have short
campaigns with one hidden effect, or none; each is diagnosed by its poses alone and with
the family. Strangers differ from the family ten times as much as its own arms. Sizes
are sqrt(lambda): of the best test of the effect, in standard deviations, with the
family.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from operator import itemgetter

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
from benchmarks.trials.lines import Line, unbroken
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series, executed
from traverse.fleet.workers import Workers
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import split
from traverse.lab.campaign.prior import Prior
from traverse.lab.diagnosis.advice.minimal_detectable import planned
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.identification.family import LEVEL, population_of
from traverse.lab.identification.identify import identify
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
class NewArm:
    """One more arm.

    Attributes:
        size: Of its effect; 0: none.
        is_strange: It does not belong to the family.
        number: Of this kind of arm, so that no two kinds have the same seeds.
    """

    n_poses: int
    size: float
    is_strange: bool
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Hidden effect of an arm, and its measurements."""

    seed: int
    truths: tuple[TrueTerm, ...]
    campaign: Campaign
    prior: Prior


def design_of() -> Arm:
    return weighed(demo_arm())


def poses_of(seed: int, n_poses: int, deviations: Deviations) -> PoseSet:
    """Make contacts of an arm with given deviations from its family."""
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


def drawn_member(seed: int) -> Campaign:
    poses = poses_of(seed, WHOLE_CAMPAIGN, SPREAD)
    return campaign_from_simulation(draw_noise(poses, seed).campaign)


def identified(campaign: Campaign) -> Line:
    """Identify it: names, values, standard deviations."""
    parameters = identify(campaign, design_of()).parameters
    return {
        key: [getattr(each, key) for each in parameters]
        for key in ("name", "value", "std")
    }


def prior_of(workers: Workers) -> Prior:
    members = Series("members", drawn_member, identified)
    batches = executed(workers, [(members, range(N_ARMS))])
    rows = sorted((line for lines in batches for line in lines), key=_seed)
    for row in rows:
        if row["error"] is not None:
            raise RuntimeError(f"member {row['seed']}: {row['error']}")
    names = tuple(rows[0]["name"])
    values, stds = (np.array([row[key] for row in rows]) for key in ("value", "std"))
    populations = [
        population_of(values[:, k], stds[:, k], LEVEL / values.size)
        for k in range(len(names))
    ]
    means, of_one_more = (
        np.array([getattr(each, key) for each in populations])
        for key in ("mean", "std")
    )
    return Prior("family", design_of(), N_ARMS, names, means, of_one_more, names)


def _seed(line: Line) -> int:
    return int(line["seed"])


def hidden_in(arm: NewArm, prior: Prior, number: int) -> Case:
    """Draw one more arm with its effect, and measure it."""
    seed = 100 * number + arm.number
    poses = poses_of(seed, arm.n_poses, _STRANGE if arm.is_strange else SPREAD)
    truths = tuple[TrueTerm, ...]()
    if arm.size:
        poses, truth = _hidden(poses, seed, arm.size, prior)
        truths = (truth,)
    campaign = campaign_from_simulation(draw_noise(poses, seed).campaign)
    return Case(seed, truths, campaign, prior)


def diagnosed(case: Case) -> Line:
    campaign = case.campaign
    return {
        "without": _judged(campaign, case),
        "with_family": _judged(replace(campaign, prior=case.prior), case),
    }


def _hidden(
    poses: PoseSet, seed: int, size: float, prior: Prior
) -> tuple[PoseSet, TrueTerm]:
    """Draw an effect that the campaign can show with the family, and play it."""
    rng = np.random.default_rng([seed, 0xFA])
    choosing, _ = split(noise_free_campaign(poses), seed)
    measure = ruler(poses, design_of(), choosing, prior)
    kinds = [kind for kind in EFFECT_KINDS if kind != NEEDS_TWO_LENGTHS]
    while True:
        effect = measure.sized(drawn(rng, poses, str(rng.choice(kinds))), size)
        if effect is not None:
            return played(poses, (effect,)), truth_of(measure, effect)


def _judged(campaign: Campaign, case: Case) -> Line:
    """Score a diagnosis, and count parameters in which the arm left its family."""
    options = DiagnosisOptions(seed=case.seed, details=False)
    try:
        diagnosis = diagnose(campaign, design_of(), options)
    except IdentificationError:  # too few poses
        return {"detected": False, "exact": False, "wrong": False, "n_left": 0}
    score = scored(case.truths, diagnosis)
    prior = diagnosis.campaign.prior
    return {
        "detected": score.detected,
        "exact": score.exact,
        "wrong": score.confident_wrong,
        "n_left": 0 if prior is None else len(prior.contradicted),
    }


def smallest_sizes(prior: Prior, n_poses: int) -> dict[str, float]:
    poses = poses_of(_FIRST_SEED, n_poses, SPREAD)
    campaign = campaign_from_simulation(draw_noise(poses, _FIRST_SEED).campaign)
    without_family, together = (
        {
            (size.candidate.identity, size.key): (
                None if size.minimum is None else size.minimum.value
            )
            for size in planned(replace(campaign, prior=known), design_of())
        }
        for known in (None, prior)
    )
    ratios = [
        least / other
        for least, other in (
            (least, together[key]) for key, least in without_family.items()
        )
        if least is not None and other is not None
    ]
    return {
        "effects": len(without_family),
        "seen_alone": sum(size is not None for size in without_family.values()),
        "seen_with_family": sum(size is not None for size in together.values()),
        "times_smaller": float(np.median(ratios)) if ratios else float("nan"),
    }


KINDS = (
    *((f"effect of {size:.0f}", size, False) for size in SIZES),
    ("no effect", 0.0, False),
    ("stranger, no effect", 0.0, True),
)
N_TRIALS = 30


def series(arguments: argparse.Namespace) -> list[Series[Case]]:
    prior = prior_of(Workers(arguments.processes, arguments.scheduler))
    print("| poses | effects seen alone | with the family | times smaller, median |")
    print("|---|---|---|---|")
    for n_poses in arguments.plans:
        row = smallest_sizes(prior, n_poses)
        print(
            f"| {n_poses} | {row['seen_alone']} of {row['effects']} | "
            f"{row['seen_with_family']} | {row['times_smaller']:.2f} |",
            flush=True,
        )
    return [
        Series(
            f"{n_poses} | {name}",
            partial(hidden_in, NewArm(n_poses, size, is_strange, number), prior),
            diagnosed,
            N_TRIALS,
            first=_FIRST_SEED,
        )
        for n_poses in arguments.poses
        for number, (name, size, is_strange) in enumerate(KINDS)
    ]


def judge(lines: Sequence[Line]) -> Verdict:
    text = [
        "\n| poses | arms | n | found: alone, family | named | wrongly named | left |",
        "|---|---|---|---|---|---|---|",
    ]
    for scenario, group in groupby(unbroken(lines), itemgetter("scenario")):
        of_kind = list(group)
        columns = [
            f"{sum(line['without'][key] for line in of_kind)}, "
            f"{sum(line['with_family'][key] for line in of_kind)}"
            for key in ("detected", "exact", "wrong")
        ]
        left = sum(line["with_family"]["n_left"] > 0 for line in of_kind)
        text.append(f"| {scenario} | {len(of_kind)} | {' | '.join(columns)} | {left} |")
    return Verdict("\n".join(text), holds=True)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    plans = [24, 36, 48, 96, WHOLE_CAMPAIGN]
    parser.add_argument("--poses", type=int, nargs="*", default=[36, 48])
    parser.add_argument(
        "--plans", type=int, nargs="*", default=plans, help="poses of planned campaigns"
    )


PROGRAM = Program("benchmarks.fleet.family", series, judge, _add_arguments)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
