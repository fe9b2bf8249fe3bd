"""All mechanical kinds at once against rigid motions."""

import numpy as np
import pytest

from tests.kinematics.effects.agreement import GRAVITY, SEEDS, across_axis, agree
from tests.kinematics.effects.reference import (
    N_JOINTS,
    T_REF,
    about,
    effect,
    random_arm,
    random_readings,
    shifted,
)
from traverse.kinematics.model.geometry import geometry_from_arm


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
