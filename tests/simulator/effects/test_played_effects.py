"""The corrections of the arm file undo the effects that the simulator plays.

Both are compared here only: neither imports the other.
"""

from datetime import timedelta

import numpy as np
import pytest

from tests.shared import shared
from tests.simulator.effects.examples import START, TABLES, example, heavy_arm, spec_of
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import utc_ns
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.simulator.campaigns import (
    BallBar,
    Cone,
    PoseSet,
    Sphere,
    make_poses,
    true_arm_file,
    with_effects,
)

ARM = heavy_arm()


@shared
def rigid() -> PoseSet:
    spec = spec_of(
        Cone(id="cone", n_poses=20),
        BallBar(id="bar", n_poses=30, radius_mm=12.7, distance_mm=400.0),
        Sphere(id="ball", n_poses=20, radius_mm=25.0, known=True),
    )
    return make_poses(ARM, spec, seed=4)


OF_ARM = sorted(set(TABLES) - {"artefact_length", "first_moment"})
# For every kind: both follow the same table to the letter, second orders included, so
# that what is left is the tolerance of the posture, 1e-10 mm an axis, and rounding.
SAME_MM = 1e-9


def found_mm(poses: PoseSet, effects: tuple[Effect, ...]) -> np.ndarray:
    """Where an arm file of the true geometry with some effects has the ball."""
    arm: Arm = true_arm_file(ARM, poses.truth)
    around = poses.around
    start_ns = utc_ns(START)
    block = Block(
        angles_rad=poses.readings_rad,
        speeds_rad_s=around.speed_rad_s,
        approaches=around.approach,
        temperature_c=around.temperature_c,
        utc_ns=start_ns + np.rint(around.time_s * 1e9).astype(np.int64),
        campaign_s=around.time_s,
        directions=around.towards,
        force_n=around.force_n,
    )
    span = (START, START + timedelta(days=1))
    return corrected_pose(
        geometry_from_arm(arm), effects_of(arm, effects, span), block
    )[0]


def worst_mm(poses: PoseSet, effects: tuple[Effect, ...]) -> float:
    misses_mm = found_mm(poses, effects) - poses.contacts_mm
    return float(np.max(np.linalg.norm(misses_mm, axis=1)))


def test_every_kind_of_the_contract_has_an_example():
    assert set(TABLES) == set(EFFECT_KINDS)


@pytest.mark.parametrize("kind", OF_ARM)
def test_an_effect_is_undone_by_its_correction_and_by_nothing_else(kind):
    poses = with_effects(rigid(), [example(kind)])
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, ()) > 0.01


@pytest.mark.parametrize(
    "kind", ["joint_compliance", "bearing_compliance", "mount_compliance"]
)
def test_first_moments_weigh_beside_the_masses(kind):
    effects = [
        example(kind),
        example("first_moment"),
        example("first_moment", joint="J7"),
    ]
    poses = with_effects(rigid(), effects)
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, poses.effects[:2]) > 1e-3
    assert worst_mm(poses, poses.effects[:1]) > 1e-3


def test_first_moments_alone_move_nothing():
    poses = with_effects(rigid(), [example("first_moment")])
    np.testing.assert_array_equal(poses.turns_rad, rigid().turns_rad)


def test_axial_runout_is_undone_too():
    values = {"cos_mm": [0.0, 0.04, 0.0], "sin_mm": [0.0, -0.03, 0.0]}
    runout = example("axis_runout", component="axial", order=1, **values)
    poses = with_effects(rigid(), [runout])
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, ()) > 0.01


@pytest.mark.parametrize(
    "covariate",
    ["temperature_c", "time_s", "force_n", "J1_speed_rad_s", "J6_temperature_c"],
)
def test_a_curve_over_any_covariate_is_undone(covariate):
    around = {"temperature_c": 20.0, "time_s": 100.0}.get(covariate, 0.2)
    knots = [around - 1.0, around - 0.1, around, around + 0.2, around + 1.0]
    poses = with_effects(
        rigid(), [example("empirical", covariate=covariate, knots=knots)]
    )
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, ()) > 0.01


def test_all_effects_together_are_undone_together():
    poses = with_effects(rigid(), [example(kind) for kind in OF_ARM])
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, poses.effects[1:]) > 0.01
    assert worst_mm(poses, poses.effects[:-1]) > 0.01


def test_two_of_one_kind_add_up():
    effects = [
        example("encoder_harmonic"),
        example("encoder_harmonic", order=7, joint="J5"),
    ]
    poses = with_effects(rigid(), effects)
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, poses.effects[:1]) > 0.01


def test_effects_of_the_arm_are_played_from_the_start():
    effects = (example("joint_compliance"), example("encoder_eccentricity"))
    arm = ARM.model_copy(update={"effects": effects})
    poses = make_poses(arm, rigid().spec, seed=4)
    repeated = with_effects(rigid(), effects)
    np.testing.assert_array_equal(poses.turns_rad, repeated.turns_rad)
    np.testing.assert_array_equal(poses.readings_rad, repeated.readings_rad)
    assert poses.effects == repeated.effects == effects


def test_without_effects_nothing_is_moved():
    poses = with_effects(with_effects(rigid(), [example("backlash")]), [])
    np.testing.assert_array_equal(poses.turns_rad, rigid().turns_rad)
    perfect_rad = rigid().turns_rad + rigid().truth.zeros_rad
    np.testing.assert_array_equal(poses.readings_rad, perfect_rad)
    assert worst_mm(rigid(), ()) < SAME_MM


def test_other_effects_do_not_depend_on_those_before():
    before = with_effects(rigid(), [example("thermal_expansion")])
    np.testing.assert_array_equal(
        with_effects(before, [example("mount_compliance")]).turns_rad,
        with_effects(rigid(), [example("mount_compliance")]).turns_rad,
    )
