"""Campaigns in which effects are hidden: arm, artefacts, conditions.

All columns of a campaign are written: times, temperature, directions of approach,
speeds, directions and forces; without them some effects are undetectable.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache

import numpy as np

from benchmarks.blind.hidden.effects import (
    EFFECT_KINDS,
    HiddenEffect,
    drawn_effect,
)
from benchmarks.blind.hidden.faults import (
    FAULT_KINDS,
    HiddenFault,
    drawn_fault,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.campaigns.artefacts import BallBar, Cone, Sphere
from traverse.simulator.campaigns.pose_set import PoseSet, with_effects
from traverse.simulator.campaigns.poses import make_poses
from traverse.simulator.campaigns.spec import CampaignSpec, ConditionTable, NoiseTable

POSE_SEEDS = (1, 2, 3, 4, 5, 6)
NEEDS_TWO_LENGTHS = "artefact_length"

Hidden = HiddenEffect | HiddenFault


@dataclass(frozen=True, slots=True)
class Round:
    """Content of one round of the blind test.

    Attributes:
        poses: in which the effects are played.
        kinds: of the effects to hide.
    """

    poses: PoseSet
    kinds: tuple[str, ...]
    pose_seed: int


def drawn_round(
    rng: np.random.Generator, arm: Arm, n_effects: int, *, outside: bool = False
) -> Round:
    """Draw kinds of effects, all alike likely and no two the same, and their poses.

    Args:
        rng: Draws.
        arm: The arm file.
        n_effects: To hide; 0 on clean data.
        outside: From outside the library of effects.
    """
    known = FAULT_KINDS if outside else EFFECT_KINDS
    kinds = tuple(str(kind) for kind in rng.choice(known, n_effects, replace=False))
    pose_seed = int(rng.choice(POSE_SEEDS))
    n_lengths = 2 if NEEDS_TWO_LENGTHS in kinds else 1
    return Round(pose_set(arm, pose_seed, n_lengths), kinds, pose_seed)


def drawn(rng: np.random.Generator, poses: PoseSet, kind: str) -> Hidden:
    """Draw one effect in a plausible size: its joint, direction, phase, moment."""
    if kind in FAULT_KINDS:
        return drawn_fault(rng, poses, kind)
    return drawn_effect(rng, poses, kind)


def played(poses: PoseSet, hidden: tuple[Hidden, ...]) -> PoseSet:
    """Play effects on contacts, in the direction of nature."""
    entries = tuple(entry.entry for entry in hidden if isinstance(entry, HiddenEffect))
    faults = tuple(entry.fault for entry in hidden if isinstance(entry, HiddenFault))
    return with_effects(poses, entries, faults)


ENCODER_RAD = 5e-6
CONTACT_MM = 0.003
START = datetime(2026, 11, 20, 9, tzinfo=UTC)
SWING_C = 2.0
SPEED_RAD_S = 0.3

# Of the bodies that joints carry, from the base outwards; the last of them repeats.
_MASSES_KG = (2.4, 1.1, 1.3, 0.9, 0.7, 0.4, 0.3)
_PROBE_KG = 0.15


def weighed(arm: Arm) -> Arm:
    """Add missing masses to an arm, so that gravity has an effect."""
    joints = tuple(
        joint
        if joint.mass_kg is not None
        else joint.model_copy(
            update={"mass_kg": _MASSES_KG[min(number, len(_MASSES_KG) - 1)]}
        )
        for number, joint in enumerate(arm.joints)
    )
    probe = arm.probe
    if probe.mass_kg is None:
        probe = probe.model_copy(update={"mass_kg": _PROBE_KG})
    return arm.model_copy(update={"joints": joints, "probe": probe})


def without_masses(arm: Arm) -> Arm:
    """Remove masses and centres of mass, which only the arm's designer can know."""
    unknown = {"mass_kg": None}
    joints = tuple(
        joint.model_copy(update={**unknown, "centre_of_mass_mm": None})
        for joint in arm.joints
    )
    probe = arm.probe.model_copy(update=unknown)
    return arm.model_copy(update={"joints": joints, "probe": probe})


def campaign_spec(n_lengths: int = 1) -> CampaignSpec:
    """Specify a campaign of 480 poses at three cones, a sphere and a bar or two.

    Args:
        n_lengths: bars, 1 or 2. A wrong length shows only beside another one.
    """
    bars = tuple(
        BallBar(
            id=f"bar-{number + 1}",
            n_poses=180 // n_lengths,
            radius_mm=12.7,
            distance_mm=distance_mm,
            distance_std_mm=0.0005,
        )
        for number, distance_mm in enumerate((500.0, 300.0)[:n_lengths])
    )
    return CampaignSpec(
        artefacts=(
            *(Cone(id=f"cone-{number}", n_poses=60) for number in (1, 2, 3)),
            Sphere(id="sphere", n_poses=120, radius_mm=25.0),
            *bars,
        ),
        noise=NoiseTable(encoder_rad=ENCODER_RAD, contact_mm=CONTACT_MM),
        conditions=ConditionTable(
            swing_c=SWING_C, speed_rad_s=SPEED_RAD_S, start_utc=START
        ),
    )


@lru_cache(maxsize=16)
def pose_set(arm: Arm, seed: int, n_lengths: int = 1) -> PoseSet:
    """Make a set of contacts once; any number of noises and effects is drawn on it.

    Args:
        arm: The arm file; it gets masses where it states none.
        seed: Of the true arm, the artefacts' places and the postures.
        n_lengths: As of `campaign_spec`.
    """
    return make_poses(weighed(arm), campaign_spec(n_lengths), seed)
