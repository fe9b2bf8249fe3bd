"""Compliances under gravity against rigid motions, and one by hand."""

import numpy as np
import pytest

from tests.kinematics.effects.agreement import GRAVITY, SEEDS, agree, poses
from tests.kinematics.effects.reference import (
    N_JOINTS,
    NAMES,
    about,
    effect,
    random_arm,
    random_readings,
)
from traverse.kinematics.arm_file.arm import parse_arm


@pytest.mark.parametrize("seed", SEEDS)
def test_joint_compliance_twists_about_the_axis_by_the_torque_of_all_weights(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = seed % N_JOINTS
    one = effect("joint_compliance", joint=NAMES[joint], compliance_rad_nm=2e-5)

    def motions(rigid, n, turns):
        axis = rigid.axes[joint]
        torque_nm = axis @ rigid.moment_nm(arm, joint, GRAVITY)
        return {joint: about(rigid.origins[joint], 2e-5 * torque_nm * axis)}

    agree(arm, (one,), readings, motions)


@pytest.mark.parametrize("seed", SEEDS)
def test_bearing_compliance_tilts_by_the_moment_across_the_axis(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = (seed + 1) % N_JOINTS
    one = effect("bearing_compliance", joint=NAMES[joint], compliance_rad_nm=3e-5)

    def motions(rigid, n, turns):
        axis = rigid.axes[joint]
        moment = rigid.moment_nm(arm, joint, GRAVITY)
        across = np.cross(axis, np.cross(moment, axis))
        return {joint: about(rigid.origins[joint], 3e-5 * across)}

    agree(arm, (one,), readings, motions)


@pytest.mark.parametrize("override", [None, np.array([5.0, 1.0, -8.0])])
@pytest.mark.parametrize("seed", SEEDS)
def test_mount_compliance_turns_everything_about_the_origin(seed, override):
    arm, readings = random_arm(seed), random_readings(seed)
    one = effect("mount_compliance", compliance_rad_nm=1e-5)
    gravity = GRAVITY if override is None else override

    def motions(rigid, n, turns):
        moment = rigid.moment_nm(arm, 0, gravity)
        down = gravity / np.linalg.norm(gravity)
        across = moment - down * (down @ moment)
        return {-1: about(np.array(arm.origin_mm), 1e-5 * across)}

    agree(arm, (one,), readings, motions, gravity_m_s2=override)


def test_weights_on_a_horizontal_link_by_hand():
    """1 m of 2 kg and a probe of 0.5 kg, 2e-5 rad per N m, about a level axis."""
    text = """
schema = "traverse/arm/1"
name = "beam"
origin_mm = [0.0, 0.0, 0.0]
[[joints]]
name = "J1"
axis = [0.0, 1.0, 0.0]
link_mm = [1000.0, 0.0, 0.0]
zero_rad = 0.0
mass_kg = 2.0
[probe]
radius_mm = 1.0
kind = "hard"
mass_kg = 0.5
[reference]
temperature_c = 20.0
gravity_m_s2 = [0.0, 0.0, -10.0]
"""
    arm = parse_arm(text)
    one = effect("joint_compliance", joint="J1", compliance_rad_nm=2e-5)
    centre, _ = poses(arm, (one,), np.zeros((1, 1)))
    # 2 kg at 0.5 m and 0.5 kg at 1 m: 15 N m downwards, that is 3e-4 rad and 0.3 mm.
    np.testing.assert_allclose(
        centre, [[1000 * np.cos(3e-4), 0, -1000 * np.sin(3e-4)]], atol=1e-12
    )
