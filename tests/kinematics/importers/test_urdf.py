"""Chains of a robot description against transforms multiplied out here."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import seeds, size_mm
from tests.kinematics.importers.matrices import place, rotation
from traverse.kinematics.importers.urdf import (
    Body,
    ChainJoint,
    arm_from_chain,
    roll_pitch_yaw,
    transform,
)
from traverse.kinematics.model.forward import joint_positions, probe_pose


def random_chain(seed, turning):
    """A chain with a fixed joint before, between and behind the turning ones."""
    rng = np.random.default_rng(seed)
    kinds = [False, *(kind for _ in range(turning) for kind in (True, False))]
    return [
        ChainJoint(
            name=f"joint_{index}",
            origin=place(rng.uniform(-400, 400, 3), rng.uniform(-3, 3, 3)),
            axis=rng.normal(size=3) if turns else None,
            bodies=tuple(
                Body(rng.uniform(0.1, 3.0), rng.uniform(-200, 200, 3))
                for _ in range(rng.integers(0, 3))
            ),
        )
        for index, turns in enumerate(kinds)
    ]


def frames(chain, readings_rad):
    """The frame behind every joint, and the number of turning joints passed."""
    pose, turned, link_frames = np.eye(4), 0, []
    for joint in chain:
        pose = pose @ joint.origin
        if joint.axis is not None:
            axis = joint.axis / np.linalg.norm(joint.axis)
            pose = pose @ rotation(axis, readings_rad[turned])
            turned += 1
        link_frames.append((pose, turned))
    return link_frames


@given(seeds, st.integers(1, 7))
def test_an_arm_of_a_chain_moves_as_its_frames_do(seed, turning):
    chain = random_chain(seed, turning)
    rng = np.random.default_rng(seed + 1)
    tool = place(rng.uniform(-200, 200, 3), rng.uniform(-3, 3, 3))
    readings_rad = rng.uniform(-7, 7, (4, turning))
    arm = arm_from_chain(chain, tool, readings_rad[0])
    centres_mm, shanks = probe_pose(arm.geometry, readings_rad)
    expected = np.array([frames(chain, row)[-1][0] @ tool for row in readings_rad])
    tolerance_mm = 1e-12 * size_mm(arm.geometry)
    np.testing.assert_allclose(
        centres_mm, expected[:, :3, 3], rtol=0, atol=tolerance_mm
    )
    np.testing.assert_allclose(shanks, expected[:, :3, 2], rtol=0, atol=1e-12)


@given(seeds, st.integers(1, 5))
def test_masses_stay_where_they_were(seed, turning):
    chain = random_chain(seed, turning)
    posture_rad = np.random.default_rng(seed + 1).uniform(-3, 3, turning)
    arm = arm_from_chain(chain, np.eye(4), posture_rad)
    origins_mm = joint_positions(arm.geometry, posture_rad[np.newaxis])[0]
    moments = np.zeros((turning + 1, 3))
    masses_kg = np.zeros(turning + 1)
    for joint, (pose, passed) in zip(chain, frames(chain, posture_rad), strict=True):
        for body in joint.bodies:
            masses_kg[passed] += body.mass_kg
            moments[passed] += body.mass_kg * (pose @ [*body.centre_mm, 1.0])[:3]
    for k, body in enumerate(arm.bodies):
        if masses_kg[k + 1] == 0.0:
            assert body is None
            continue
        assert body.mass_kg == pytest.approx(masses_kg[k + 1], rel=1e-13)
        np.testing.assert_allclose(
            origins_mm[k] + body.centre_mm,
            moments[k + 1] / masses_kg[k + 1],
            rtol=0,
            atol=1e-9,
        )


@given(st.lists(st.floats(-3.2, 3.2), min_size=3, max_size=3))
def test_roll_pitch_yaw_make_the_rotation_that_the_specification_says(rpy_rad):
    made = transform([1.0, 2.0, 3.0], rpy_rad)
    np.testing.assert_allclose(
        made, place([1.0, 2.0, 3.0], rpy_rad), rtol=0, atol=1e-14
    )
    repeated = transform(made[:3, 3], roll_pitch_yaw(made[:3, :3]))
    np.testing.assert_allclose(repeated, made, rtol=0, atol=1e-11)


@pytest.mark.parametrize("pitch_rad", [np.pi / 2, -np.pi / 2])
def test_a_pitch_of_a_quarter_turn_still_gives_the_rotation_back(pitch_rad):
    made = place(np.zeros(3), [0.3, pitch_rad, -1.1])
    repeated = transform(np.zeros(3), roll_pitch_yaw(made[:3, :3]))
    np.testing.assert_allclose(repeated, made, rtol=0, atol=1e-11)
