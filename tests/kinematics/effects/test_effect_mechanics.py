"""Mechanical kinds without weights, each against rigid motions.

Compliances under gravity against rigid motions.
All mechanical kinds at once against rigid motions.
"""

import numpy as np
import pytest

from tests.kinematics.effects.agreement import GRAVITY, SEEDS, across_axis, agree
from tests.kinematics.effects.reference import (
    EPOCH,
    EPOCH_NS,
    N_JOINTS,
    NAMES,
    T_REF,
    about,
    effect,
    random_arm,
    random_readings,
    shifted,
)
from traverse.kinematics.arm_file.arm import Identification
from traverse.kinematics.model.geometry import geometry_from_arm


@pytest.mark.parametrize("order", [2, 5])
@pytest.mark.parametrize("seed", SEEDS)
def test_wobble_tilts_what_the_joint_carries(seed, order):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = (seed + 2) % N_JOINTS
    cos, sin = across_axis(arm, joint, seed)
    correction = effect(
        "axis_wobble", joint=NAMES[joint], order=order, cos_rad=[*cos], sin_rad=[*sin]
    )

    def motions(rigid, n, turns):
        wave = cos * np.cos(order * turns[joint]) + sin * np.sin(order * turns[joint])
        return {joint: about(rigid.origins[joint], rigid.carried[joint][:3, :3] @ wave)}

    agree(arm, (correction,), readings, motions)


@pytest.mark.parametrize("component", ["radial", "axial"])
@pytest.mark.parametrize("seed", SEEDS)
def test_runout_shifts_the_origin_of_the_joint_and_all_beyond(seed, component):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = (seed + 3) % N_JOINTS
    axis = geometry_from_arm(arm).axes[joint]
    cos, sin = (
        100 * across_axis(arm, joint, seed)
        if component == "radial"
        else np.outer([0.003, -0.002], axis)
    )
    correction = effect(
        "axis_runout",
        joint=NAMES[joint],
        component=component,
        order=3,
        cos_mm=[*cos],
        sin_mm=[*sin],
    )

    def motions(rigid, n, turns):
        wave = cos * np.cos(3 * turns[joint]) + sin * np.sin(3 * turns[joint])
        return {joint: shifted(rigid.carried[joint][:3, :3] @ wave)}

    agree(arm, (correction,), readings, motions)


@pytest.mark.parametrize("seed", SEEDS)
def test_expansion_lengthens_one_element_by_its_own_temperature(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = seed % N_JOINTS
    own_c = T_REF + np.random.default_rng(seed).uniform(2, 9, readings.shape)
    correction = effect("thermal_expansion", joint=NAMES[joint], expansion_per_c=23e-6)

    def motions(rigid, n, turns):
        growth = 23e-6 * (own_c[n, joint] - T_REF)
        return {joint: shifted(growth * rigid.links[joint])}

    agree(arm, (correction,), readings, motions, joint_temperatures_c=own_c)


def test_expansion_without_a_joint_lengthens_all_elements_but_not_the_probe():
    arm, readings = random_arm(3), random_readings(3)
    arm_c = np.full(len(readings), T_REF - 6)
    own_c = np.full(readings.shape, np.nan)
    own_c[:, 1] = T_REF + 2.0  # the others have none of their own: the arm's counts
    correction = effect("thermal_expansion", expansion_per_c=1e-5)

    def motions(rigid, n, turns):
        growth = np.full(N_JOINTS, -6e-5)
        growth[1] = 2e-5
        return {-1: shifted(growth @ np.array(rigid.links))}

    agree(
        arm,
        (correction,),
        readings,
        motions,
        temperature_c=arm_c,
        joint_temperatures_c=own_c,
    )


def test_base_drifts_with_time_inside_its_campaign_and_steps_for_good():
    arm, readings = random_arm(5), random_readings(5)
    seconds = np.array([0.0, 100.0, 250.0, 9000.0])
    an_hour_later = Identification(date="2026-11-20T10:00:00Z")
    dated = arm.model_copy(update={"identification": an_hour_later})
    drift = effect("base_drift", rate_mm_s=[1e-5, -2e-5, 0.0], epoch_utc=EPOCH)
    step = effect("base_step", at_s=200.0, step_mm=[0.0, 0.1, -0.05], epoch_utc=EPOCH)

    def motions(rigid, n, turns):
        held = min(seconds[n], 3600.0)
        base = held * np.array([1e-5, -2e-5, 0]) + (seconds[n] >= 200) * np.array(
            [0, 0.1, -0.05]
        )
        return {-1: shifted(base)}

    utc_ns = EPOCH_NS + (seconds * 1e9).astype(np.int64)
    agree(dated, (drift, step), readings, motions, utc_ns=utc_ns)


@pytest.mark.parametrize("seed", SEEDS)
def test_joint_compliance_twists_about_the_axis_by_the_torque_of_all_weights(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = seed % N_JOINTS
    correction = effect("joint_compliance", joint=NAMES[joint], compliance_rad_nm=2e-5)

    def motions(rigid, n, turns):
        axis = rigid.axes[joint]
        torque_nm = axis @ rigid.moment_nm(arm, joint, GRAVITY)
        return {joint: about(rigid.origins[joint], 2e-5 * torque_nm * axis)}

    agree(arm, (correction,), readings, motions)


@pytest.mark.parametrize("seed", SEEDS)
def test_bearing_compliance_tilts_by_the_moment_across_the_axis(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = (seed + 1) % N_JOINTS
    correction = effect(
        "bearing_compliance", joint=NAMES[joint], compliance_rad_nm=3e-5
    )

    def motions(rigid, n, turns):
        axis = rigid.axes[joint]
        moment = rigid.moment_nm(arm, joint, GRAVITY)
        across = np.cross(axis, np.cross(moment, axis))
        return {joint: about(rigid.origins[joint], 3e-5 * across)}

    agree(arm, (correction,), readings, motions)


@pytest.mark.parametrize("override", [None, np.array([5.0, 1.0, -8.0])])
@pytest.mark.parametrize("seed", SEEDS)
def test_mount_compliance_turns_everything_about_the_origin(seed, override):
    arm, readings = random_arm(seed), random_readings(seed)
    correction = effect("mount_compliance", compliance_rad_nm=1e-5)
    gravity = GRAVITY if override is None else override

    def motions(rigid, n, turns):
        moment = rigid.moment_nm(arm, 0, gravity)
        down = gravity / np.linalg.norm(gravity)
        across = moment - down * (down @ moment)
        return {-1: about(np.array(arm.origin_mm), 1e-5 * across)}

    agree(arm, (correction,), readings, motions, gravity_m_s2=override)


@pytest.mark.parametrize("seed", SEEDS)
def test_all_mechanical_kinds_together_are_motions_from_the_outermost_inwards(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    cos, sin = across_axis(arm, 1, seed)
    far = 50 * across_axis(arm, 3, seed)
    first_axis = geometry_from_arm(arm).axes[0]
    arm_c = np.full(len(readings), T_REF + 8)
    effects = (
        effect("encoder_scale", joint="J4", scale_ppm=40.0),
        effect("axis_wobble", joint="J2", order=2, cos_rad=[*cos], sin_rad=[*sin]),
        effect("bearing_compliance", joint="J2", compliance_rad_nm=1e-5),
        effect("joint_compliance", joint="J2", compliance_rad_nm=4e-5),
        effect("joint_compliance", joint="J4", compliance_rad_nm=2e-5),
        effect(
            "axis_runout",
            joint="J4",
            component="radial",
            order=2,
            cos_mm=[*far[0]],
            sin_mm=[*far[1]],
        ),
        effect(
            "axis_runout",
            joint="J1",
            component="axial",
            order=1,
            cos_mm=[*(0.02 * first_axis)],
            sin_mm=[*(0.01 * first_axis)],
        ),
        effect("thermal_expansion", joint="J3", expansion_per_c=2e-5),
        effect("mount_compliance", compliance_rad_nm=5e-6),
    )

    def motions(rigid, n, turns):
        moments = [rigid.moment_nm(arm, k, GRAVITY) for k in range(N_JOINTS)]
        torque = [rigid.axes[k] @ moments[k] for k in range(N_JOINTS)]
        wave = cos * np.cos(2 * turns[1]) + sin * np.sin(2 * turns[1])
        tilt = rigid.carried[1][:3, :3] @ wave
        tilt = tilt + 1e-5 * (moments[1] - rigid.axes[1] * torque[1])
        runout = far[0] * np.cos(2 * turns[3]) + far[1] * np.sin(2 * turns[3])
        return {
            -1: about(np.array(arm.origin_mm), 5e-6 * moments[0]),
            0: shifted(
                (0.02 * np.cos(turns[0]) + 0.01 * np.sin(turns[0])) * first_axis
            ),
            1: about(rigid.origins[1], tilt)
            @ about(rigid.origins[1], 4e-5 * torque[1] * rigid.axes[1]),
            2: shifted(2e-5 * 8 * rigid.links[2]),
            3: shifted(rigid.carried[3][:3, :3] @ runout)
            @ about(rigid.origins[3], 2e-5 * torque[3] * rigid.axes[3]),
        }

    def turns_of(n, sample):
        zero = geometry_from_arm(arm).zeros_rad[3]
        return np.array([0, 0, 0, 40e-6 * (sample[3] - zero), 0, 0])

    agree(arm, effects, readings, motions, turns_of, temperature_c=arm_c)
