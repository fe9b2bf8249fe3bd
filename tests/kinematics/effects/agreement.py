"""Compare poses with rigid motions, sample by sample."""

import numpy as np

from tests.kinematics.effects.reference import Rigid
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm

SEEDS = range(6)
GRAVITY = np.array([0.3, -0.8, -9.7])
ATOL_MM = 2e-10


def poses(arm, effects, readings, **covariates):
    geometry = geometry_from_arm(arm)
    block = Block(readings, **covariates)
    return corrected_pose(geometry, effects_of(arm, effects), block)[:2]


def agree(arm, effects, readings, motions_of, turns_of=None, **covariates):
    """Compare every sample with motions_of(rigid, sample number, turns)."""
    geometry = geometry_from_arm(arm)
    centres, shanks = poses(arm, effects, readings, **covariates)
    nominal, _ = poses(arm, (), readings)
    assert np.abs(centres - nominal).max() > 1e-4, "the effect does nothing"
    for n, sample in enumerate(readings):
        turns = sample - geometry.zeros_rad
        if turns_of is not None:
            turns = turns - turns_of(n, sample)
        rigid = Rigid(geometry, turns)
        ball, shank = rigid.moved(motions_of(rigid, n, turns))
        np.testing.assert_allclose(centres[n], ball, rtol=0, atol=ATOL_MM)
        np.testing.assert_allclose(shanks[n], shank, rtol=0, atol=1e-12)


def across_axis(arm, joint, seed):
    axis = geometry_from_arm(arm).axes[joint]
    across = np.cross(axis, np.random.default_rng(seed).normal(size=(2, 3)))
    return 1e-4 * across
