"""Experiments that separate a finding from its alternatives, in words.

Some pairs of effects are known to be hard to separate: why, and what separates them.
Some are aliases by structure: no poses of the same kind ever would.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.contacts.touching import ProbeRadius, StylusBending
from traverse.kinematics.effects.mechanics.deformations import (
    BearingCompliance,
    MountCompliance,
    ThermalExpansion,
)
from traverse.kinematics.effects.mechanics.motions import AxisRunout, AxisWobble
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.advice.minimal_detectable import (
    is_vertical,
    probe_is_on_axis,
)
from traverse.lab.diagnosis.advice.optimal_poses import Experiment, experiment
from traverse.lab.diagnosis.candidates.scoring import ALIAS
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.diagnosis.search.naming import NamedTerm
from traverse.lab.outcomes.candidate import Candidate
from traverse.lab.outcomes.diagnosis import Alternative
from traverse.lab.report.templates import Words
from traverse.strict_toml.files import text_of


@dataclass(frozen=True, slots=True)
class KnownPair:
    """Two effects that are hard to separate; by structure: no such poses ever would."""

    why: str
    experiment: str
    is_structural: bool = False


def known_pair(
    first: Candidate, second: Candidate, rows: ObservationEquations
) -> KnownPair | None:
    """Look two effects up among the pairs that are hard to separate.

    The rows of the fit say which joint is the last, and what each has travelled.
    """
    kinds = {first.kind, second.kind}
    families = _family(first), _family(second)
    base_joint = rows.adjustment.network.campaign.joint_names[0]
    if kinds == {MountCompliance.kind, BearingCompliance.kind} and (
        base_joint in (first.joint, second.joint)
    ):
        return KnownPair(
            "both tilt everything above the base by the overturning moment",
            "hang a known mass on the mount beside the arm, or touch a cone on the "
            "mount plate and one on the floor, or measure with the base tilted",
            is_vertical(rows, base_joint),
        )
    if first.joint is not None and first.joint == second.joint:
        of_joint = _of_one_joint(first.joint, kinds, set(families), rows)
        if of_joint is not None:
            return of_joint
    if kinds == {ProbeRadius.kind, StylusBending.kind}:
        return KnownPair(
            "along the normal of a surface both are the same for a constant force",
            "touch with two forces, a sphere from outside and one from inside, and a "
            "cone",
            True,
        )
    if Family.LENGTH in families:
        is_only = len({of for _, of, _ in rows.certificates}) < 2
        more = "a second" if is_only else "one more"
        return KnownPair(
            "an error of the standard's length changes the scale of the whole arm",
            f"measure {more} calibrated length, of another standard",
            is_only and ThermalExpansion.kind in kinds,
        )
    names = sorted(family.name for family in families)
    for pair in _PAIRS:
        alike = pair["families"]
        if names == sorted(alike) or (len(alike) == 1 and alike[0] in names):
            return KnownPair(pair["why"], pair["experiment"])
    return None


def _of_one_joint(
    joint: str, kinds: set[str], families: set[Family], rows: ObservationEquations
) -> KnownPair | None:
    campaign = rows.adjustment.network.campaign
    if families == {Family.OWN_ANGLE, Family.AXIS_MOTION}:
        moving = [n for n in campaign.joint_names if not probe_is_on_axis(rows, n)]
        if joint == (moving or campaign.joint_names)[-1]:
            return KnownPair(
                f"with one stylus an angle error of {joint} is a shift of the ball",
                "measure with a second stylus of another length or offset",
                True,
            )
        return KnownPair(
            f"the probe is always about as far from the axis of {joint}",
            f"touch with the joints beyond {joint} stretched and bent, and with a "
            "stylus of another length",
        )
    if families == {Family.OWN_ANGLE} or (
        families == {Family.AXIS_MOTION} and len(kinds) == 1
    ):
        joint_index = campaign.joint_names.index(joint)
        travelled_rad = float(
            np.ptp(campaign.poses.angles_rad[rows.used_poses, joint_index])
        )
        return KnownPair(
            f"{joint} travelled {travelled_rad:.1f} rad only, where both look alike"
            if travelled_rad < 2.0 * np.pi
            else f"both are functions of the reading of {joint}",
            f"turn {joint} through a wider range, out to both of its stops, with one "
            "artefact close to the base and one far from it",
        )
    if kinds == {AxisWobble.kind, AxisRunout.kind}:
        return KnownPair(
            f"the lever arm from {joint} to the ball hardly varies",
            "measure with styli of two lengths, the joints beyond stretched and bent",
        )
    return None


def _family(candidate: Candidate) -> Family:
    return EFFECT_KINDS[candidate.kind].family


_PAIRS = tomllib.loads(text_of(Path(__file__).with_name("known_pairs.toml")))["pairs"]
WORDS = Words("diagnosis/advice/words.jinja")

# Evidence that takes a name out of the printed set, as natural logarithm.
_SETTLED = float(np.log(100.0))
# Of the normal distribution: 90 % of the experiments bring that evidence.
_SURE = 1.28
_MOST_POSES = 40
_MOST_RIVALS = 4
# How far a joint may go beyond what it has travelled.
_BEYOND_RAD = 1.0
# Correlation above which a pair of the table that is one by structure is one here.
_NEARLY_ALIAS = 0.99


def separate_by(naming: NamedTerm, rows: ObservationEquations, arm: Arm) -> str:
    """Return which experiment separates a finding from its alternatives, if any."""
    candidate = naming.choice.candidate
    sentences, apart = [], []
    named = [o for o in naming.alternatives if not o.candidate.is_curve]
    if not named or candidate.is_curve:
        if not naming.alternatives:
            return ""
        return WORDS.curve(
            candidate if candidate.is_curve else naming.alternatives[0].candidate
        )
    for other in named:
        known = known_pair(candidate, other.candidate, rows)
        if _is_structural(other, known):
            sentences.append(WORDS.alias(candidate, other.candidate, known))
        else:
            apart.append(other)
    if not apart:
        return " ".join(sentences[:1])
    for n in (_MOST_RIVALS, 1) if len(apart) > 1 else (1,):
        others = apart[:n]  # all others, or at least the best one
        plan = optimal_experiment(naming, others, rows, arm)
        if plan is not None:
            sentences.insert(0, _poses_in_words(candidate, others, plan, rows))
            break
    else:
        known = known_pair(candidate, apart[0].candidate, rows)
        sentences.insert(0, WORDS.experiment(candidate, apart[0], known, _MOST_POSES))
    return " ".join(sentences[:2])


def optimal_experiment(
    naming: NamedTerm,
    others: Sequence[Alternative],
    rows: ObservationEquations,
    arm: Arm,
) -> Experiment | None:
    """Choose the poses that separate a finding from other names.

    Within what the joints have travelled, or, where that is not enough, a radian
    beyond it in the joints of the effects. None where it does not depend on poses, or
    where more poses than anyone likes to measure would be needed.
    """
    chosen = naming.choice
    effects = (chosen.candidate, *(other.candidate for other in others))
    of_poses = [EFFECT_KINDS[effect.kind].depends_on_posture for effect in effects]
    if not of_poses[0] and not all(of_poses[1:]):
        return None
    amplitudes, _ = chosen.projected.amplitudes(chosen.residuals)
    gains = [
        gain_needed(chosen.score - other.log_bayes_factor - other.candidate.log_prior)
        for other in others
    ]
    joints = {involved.joint for involved in effects}
    names = rows.adjustment.network.campaign.joint_names
    beyond_rad = np.array([_BEYOND_RAD * (name in joints) for name in names])
    for wider_rad in (np.zeros(len(names)), beyond_rad):
        plan = experiment(
            effects,
            amplitudes,
            rows,
            arm,
            gains=gains,
            index=naming.added.index,
            wider_rad=wider_rad,
            n_most=_MOST_POSES,
        )
        if plan is None or plan.is_enough:
            return plan
    return None


def gain_needed(ahead: float) -> float:
    """Return the growth of the separation that excludes a name from the set.

    A separation of Delta yields the evidence Delta / 2 on average, with the standard
    deviation sqrt(Delta); the finding leads already by some (natural logarithm).
    """
    lacking = max(_SETTLED - ahead, 1.0)
    return float((_SURE + np.sqrt(_SURE**2 + 2.0 * lacking)) ** 2)


def postures_text(poses_rad: Floats, campaign: Campaign, joints: Sequence[str]) -> str:
    """Describe where chosen poses lie, compared with those that were measured.

    The poses are readings, (n_poses, n_joints); the joints named are looked at first.
    """
    names = list(campaign.joint_names)
    order = [names.index(joint) for joint in joints]
    order += [index for index in range(len(names)) if index not in order]
    measured_rad = campaign.poses.angles_rad
    for index in order:
        least, largest = measured_rad[:, index].min(), measured_rad[:, index].max()
        outside = (poses_rad[:, index] < least) | (poses_rad[:, index] > largest)
        if np.mean(outside) > 0.5:
            return (
                f"with {names[index]} beyond what it has travelled, below {least:.1f} "
                f"rad or above {largest:.1f} rad"
            )
        low, high = np.quantile(measured_rad[:, index], (0.2, 0.8))
        below = float(np.mean(poses_rad[:, index] < low))
        above = float(np.mean(poses_rad[:, index] > high))
        if max(below, above) > 0.6:
            return (
                f"with {names[index]} above {high:.1f} rad"
                if above > below
                else f"with {names[index]} below {low:.1f} rad"
            )
        if below + above > 0.75:
            return (
                f"with {names[index]} near the ends of its travel, below {low:.1f} rad "
                f"and above {high:.1f} rad"
            )
    return "in postures all over the travelled ranges"


def _is_structural(other: Alternative, known: KnownPair | None) -> bool:
    if known is not None and known.is_structural:
        return other.correlation >= _NEARLY_ALIAS
    return known is None and other.correlation >= ALIAS


def _poses_in_words(
    candidate: Candidate,
    others: Sequence[Alternative],
    plan: Experiment,
    rows: ObservationEquations,
) -> str:
    """Describe the poses (number, place, gain) and the known experiment."""
    n, campaign = len(plan.poses), rows.adjustment.network.campaign
    effects = (candidate, *(other.candidate for other in others))
    joints = dict.fromkeys(
        effect.joint for effect in effects if effect.joint is not None
    )
    where = postures_text(plan.poses.angles_rad, campaign, tuple(joints))
    touched = np.bincount(plan.poses.artefacts, minlength=len(campaign.artefacts))
    best = int(np.argmax(touched))
    place = f"{'' if touched[best] == n else 'mostly '}at {campaign.artefacts[best].id}"
    chance = max(100.0 * float(np.max(plan.chances[-1])), 0.1)
    names = [other.candidate.name for other in others]
    known = known_pair(candidate, others[0].candidate, rows)
    return WORDS.poses(candidate, names, n, where, place, chance, known)
