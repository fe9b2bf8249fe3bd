"""Pairs of effects that are hard to separate: why, and what separates them.

Some are aliases by structure: no poses of the same kind ever would.
"""

from dataclasses import dataclass

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.contacts.touching import ProbeRadius, StylusBending
from traverse.kinematics.effects.mechanics.deformations import (
    BearingCompliance,
    MountCompliance,
    ThermalExpansion,
)
from traverse.kinematics.effects.mechanics.motions import AxisRunout, AxisWobble
from traverse.lab.diagnosis.advice.minimal_detectable import (
    is_vertical,
    probe_is_on_axis,
)
from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations


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
        found = _of_one_joint(first.joint, kinds, set(families), rows)
        if found is not None:
            return found
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
    for one, other, why, experiment in _FAMILIES:
        if families in ((one, other), (other, one)) or (
            other is None and one in families
        ):
            return KnownPair(why, experiment)
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
        at = campaign.joint_names.index(joint)
        travelled_rad = float(np.ptp(campaign.poses.angles_rad[rows.used_poses, at]))
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


_WITH_AND_WITHOUT_MASS = (
    "the moment of gravity is a first harmonic of a joint that is not vertical",
    "measure with a known mass at the wrist and without (only what gravity does "
    "grows), or with the base tilted",
)
# Two families (None: any), why they are alike, and what separates them: the first that
# fits counts.
_FAMILIES: tuple[tuple[Family, Family | None, str, str], ...] = (
    (
        Family.GRAVITY,
        Family.GRAVITY,
        "both follow the moments of the arm's own weight",
        "hang a known mass at the wrist and then at the elbow, or tilt the base",
    ),
    (Family.GRAVITY, Family.OWN_ANGLE, *_WITH_AND_WITHOUT_MASS),
    (Family.GRAVITY, Family.AXIS_MOTION, *_WITH_AND_WITHOUT_MASS),
    (
        Family.CONTACT,
        Family.CONTACT,
        "both act along the normal of a touched surface",
        "touch a sphere all around with the shank in many attitudes and two forces",
    ),
    (
        Family.MOVING,
        Family.MOVING,
        "both follow the sense of the last motion",
        "approach the same points at two speeds, from both sides, turning one "
        "joint at a time",
    ),
    (
        Family.MOVING,
        None,
        "poses and motions went together",
        "repeat the same poses at another speed and from the other side",
    ),
    (
        Family.WARM,
        Family.SLOW,
        "the temperature went up while time went by",
        "let the temperature go up and down again while measuring, and repeat the "
        "first artefact at the end",
    ),
    (
        Family.WARM,
        Family.WARM,
        "one warm-up moves everything at once",
        "touch stretched and bent at the same temperature, and warm one link "
        "after the other",
    ),
    (
        Family.SLOW,
        Family.SLOW,
        "both change slowly with time",
        "go through the artefacts in turn, all around the base, and touch one "
        "cone again every 20 poses",
    ),
    (
        Family.WARM,
        None,
        "poses and temperatures went together",
        "repeat the same poses at another temperature",
    ),
    (
        Family.SLOW,
        None,
        "poses were measured in an order that follows a joint",
        "repeat the same poses later, in another order",
    ),
)
