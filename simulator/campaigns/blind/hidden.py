"""What is hidden in a blind test: drawn from a seed, played, revealed afterwards."""

from dataclasses import dataclass

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.campaigns.blind.effects import (
    EFFECT_KINDS,
    HiddenEffect,
    drawn_effect,
)
from traverse.simulator.campaigns.blind.faults import (
    FAULT_KINDS,
    HiddenFault,
    drawn_fault,
)
from traverse.simulator.campaigns.blind.poses import pose_set
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.campaigns.with_effects import with_effects

POSE_SEEDS = (1, 2, 3, 4, 5, 6)
NEEDS_TWO_LENGTHS = "artefact_length"

Hidden = HiddenEffect | HiddenFault


@dataclass(frozen=True, slots=True)
class Round:
    """What one round of the blind test is about.

    Attributes:
        poses: Where the effects are played.
        kinds: Of the effects to hide.
        pose_seed: Which set of poses it is.
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
    """Play effects on contacts, in the direction in which nature works."""
    entries = tuple(one.entry for one in hidden if isinstance(one, HiddenEffect))
    faults = tuple(one.fault for one in hidden if isinstance(one, HiddenFault))
    return with_effects(poses, entries, faults)
