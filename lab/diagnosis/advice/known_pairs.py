"""Pairs of effects that are hard to separate: why, and what separates them.

Some are aliases by structure: no poses of the same kind ever would.
"""

from collections.abc import Callable
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
    for rule in _RULES:
        for one, other in ((first, second), (second, first)):
            found = rule(one, other, rows)
            if found is not None:
                return found
    return None


def _mount_and_first_bearing(
    one: Candidate, other: Candidate, rows: ObservationEquations
) -> KnownPair | None:
    first_joint = rows.adjustment.network.campaign.joint_names[0]
    if (one.kind, other.kind) != (MountCompliance.kind, BearingCompliance.kind) or (
        other.joint != first_joint
    ):
        return None
    return KnownPair(
        "both tilt everything above the base by the overturning moment",
        "hang a known mass on the mount beside the arm, or touch a cone on the mount "
        "plate and one on the floor, or measure with the base tilted",
        is_vertical(rows, first_joint),
    )


def _angle_and_motion(
    one: Candidate, other: Candidate, rows: ObservationEquations
) -> KnownPair | None:
    if _family(one) is not Family.OWN_ANGLE or _family(other) is not Family.AXIS_MOTION:
        return None
    if one.joint != other.joint:
        return None
    if one.joint == _last_moving(rows):
        return KnownPair(
            f"with one stylus an angle error of {one.joint} is a shift of the ball",
            "measure with a second stylus of another length or offset",
            True,
        )
    return KnownPair(
        f"the probe is always about as far from the axis of {one.joint}",
        f"touch with the joints beyond {one.joint} stretched and bent, and with a "
        "stylus of another length",
    )


def _of_one_angle(
    one: Candidate, other: Candidate, rows: ObservationEquations
) -> KnownPair | None:
    if one.joint != other.joint or one.joint is None:
        return None
    both_angles = (
        _family(one) is Family.OWN_ANGLE and _family(other) is Family.OWN_ANGLE
    )
    if not both_angles and (
        one.kind != other.kind or _family(one) is not Family.AXIS_MOTION
    ):
        return None
    campaign = rows.adjustment.network.campaign
    at = campaign.joint_names.index(one.joint)
    travelled_rad = float(np.ptp(campaign.poses.angles_rad[rows.used_poses, at]))
    return KnownPair(
        f"{one.joint} travelled {travelled_rad:.1f} rad only, where both look alike"
        if travelled_rad < 2.0 * np.pi
        else f"both are functions of the reading of {one.joint}",
        f"turn {one.joint} through a wider range, out to both of its stops, with one "
        "artefact close to the base and one far from it",
    )


def _wobble_and_runout(
    one: Candidate, other: Candidate, _rows: ObservationEquations
) -> KnownPair | None:
    if (one.kind, other.kind) != (
        AxisWobble.kind,
        AxisRunout.kind,
    ) or one.joint != other.joint:
        return None
    return KnownPair(
        f"the lever arm from {one.joint} to the ball hardly varies",
        "measure with styli of two lengths, the joints beyond stretched and bent",
    )


def _radius_and_bending(
    one: Candidate, other: Candidate, _rows: ObservationEquations
) -> KnownPair | None:
    if {one.kind, other.kind} != {ProbeRadius.kind, StylusBending.kind}:
        return None
    return KnownPair(
        "along the normal of a surface both are the same for a constant force",
        "touch with two forces, a sphere from outside and one from inside, and a cone",
        True,
    )


def _length(
    one: Candidate, other: Candidate, rows: ObservationEquations
) -> KnownPair | None:
    if _family(one) is not Family.LENGTH:
        return None
    lengths = {of for _, of, _ in rows.certificates}
    return KnownPair(
        "an error of the standard's length changes the scale of the whole arm",
        "measure a second calibrated length, of another standard"
        if len(lengths) < 2
        else "measure one more calibrated length, of another standard",
        len(lengths) < 2 and other.kind == ThermalExpansion.kind,
    )


def _family(candidate: Candidate) -> Family:
    return EFFECT_KINDS[candidate.kind].family


def _last_moving(rows: ObservationEquations) -> str:
    """Find the last joint that moves the probe."""
    names = rows.adjustment.network.campaign.joint_names
    moving = [name for name in names if not probe_is_on_axis(rows, name)]
    return moving[-1] if moving else names[-1]


# A family, another one (None: any), why they are alike, and what separates them.
_Alike = tuple[Family, Family | None, str, str]
_Rule = Callable[[Candidate, Candidate, ObservationEquations], KnownPair | None]


def _families(*table: _Alike) -> _Rule:
    """Make the rule of a table of families, of which the first that fits counts."""

    def rule(
        one: Candidate, other: Candidate, _rows: ObservationEquations
    ) -> KnownPair | None:
        for own, beside, why, experiment in table:
            if own is _family(one) and beside in (None, _family(other)):
                return KnownPair(why, experiment)
        return None

    return rule


_WITH_AND_WITHOUT_MASS = (
    "the moment of gravity is a first harmonic of a joint that is not vertical",
    "measure with a known mass at the wrist and without (only what gravity does "
    "grows), or with the base tilted",
)
_RULES: tuple[_Rule, ...] = (
    _mount_and_first_bearing,
    _angle_and_motion,
    _of_one_angle,
    _wobble_and_runout,
    _radius_and_bending,
    _families(
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
    ),
    _length,
    _families(
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
    ),
    _families(
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
    ),
)
