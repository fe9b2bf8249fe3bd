"""Mechanical kinds without weights, each against rigid motions."""

import numpy as np
import pytest

from tests.kinematics.effects.agreement import SEEDS, across_axis, agree
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
    one = effect(
        "axis_wobble", joint=NAMES[joint], order=order, cos_rad=[*cos], sin_rad=[*sin]
    )

    def motions(rigid, n, turns):
        wave = cos * np.cos(order * turns[joint]) + sin * np.sin(order * turns[joint])
        return {joint: about(rigid.origins[joint], rigid.carried[joint][:3, :3] @ wave)}

    agree(arm, (one,), readings, motions)


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
    one = effect(
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

    agree(arm, (one,), readings, motions)


@pytest.mark.parametrize("seed", SEEDS)
def test_expansion_lengthens_one_element_by_its_own_temperature(seed):
    arm, readings = random_arm(seed), random_readings(seed)
    joint = seed % N_JOINTS
    own_c = T_REF + np.random.default_rng(seed).uniform(2, 9, readings.shape)
    one = effect("thermal_expansion", joint=NAMES[joint], expansion_per_c=23e-6)

    def motions(rigid, n, turns):
        growth = 23e-6 * (own_c[n, joint] - T_REF)
        return {joint: shifted(growth * rigid.links[joint])}

    agree(arm, (one,), readings, motions, joint_temperatures_c=own_c)


def test_expansion_without_a_joint_lengthens_all_elements_but_not_the_probe():
    arm, readings = random_arm(3), random_readings(3)
    arm_c = np.full(len(readings), T_REF - 6)
    own_c = np.full(readings.shape, np.nan)
    own_c[:, 1] = T_REF + 2.0  # the others have none of their own: the arm's counts
    one = effect("thermal_expansion", expansion_per_c=1e-5)

    def motions(rigid, n, turns):
        growth = np.full(N_JOINTS, -6e-5)
        growth[1] = 2e-5
        return {-1: shifted(growth @ np.array(rigid.links))}

    agree(
        arm,
        (one,),
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
