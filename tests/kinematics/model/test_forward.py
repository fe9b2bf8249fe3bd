"""Turning vectors in place: against the sine, the cosine and another formula."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import geometries, random_geometry, seeds, size_mm
from traverse.kinematics.model.backward_recursion import (
    BackwardRecursion,
    JointRotations,
)
from traverse.kinematics.model.forward import joint_positions, probe_centre, probe_pose
from traverse.kinematics.model.geometry import unit_vectors

RELATIVE = 1e-12


def postures(geometry, seed, n_samples=5):
    rng = np.random.default_rng(seed)
    return rng.uniform(-8, 8, (n_samples, geometry.n_joints))


def rotation_matrix(axis, angle):
    """Rodrigues' formula, 3x3."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def turn_about_line(point, axis, angle):
    """4x4 motion about the line through a point."""
    motion = np.eye(4)
    motion[:3, :3] = rotation_matrix(axis, angle)
    motion[:3, 3] = point - motion[:3, :3] @ point
    return motion


def pose_by_matrices(geometry, angles):
    """Product of exponentials about the joints' lines in the base posture."""
    motion, origin = np.eye(4), geometry.origin_mm
    for axis, link, zero, angle in zip(
        geometry.axes, geometry.links_mm, geometry.zeros_rad, angles, strict=True
    ):
        motion = motion @ turn_about_line(origin, axis, angle - zero)
        origin = origin + link
    probe = np.append(origin + geometry.probe_vector_mm, 1.0)
    return (motion @ probe)[:3], motion[:3, :3] @ geometry.probe_direction


@given(geometries, seeds)
def test_pose_agrees_with_homogeneous_matrices(geometry, seed):
    angles = postures(geometry, seed)
    centres, directions = probe_pose(geometry, angles)
    for sample, centre, direction in zip(angles, centres, directions, strict=True):
        expected_centre, expected_direction = pose_by_matrices(geometry, sample)
        error = np.abs(centre - expected_centre).max()
        assert error <= RELATIVE * size_mm(geometry)
        np.testing.assert_allclose(direction, expected_direction, rtol=0, atol=1e-12)


@given(geometries, seeds)
def test_skeleton_keeps_the_lengths_of_the_links(geometry, seed):
    skeleton = joint_positions(geometry, postures(geometry, seed))
    assert skeleton.shape == (5, geometry.n_joints + 1, 3)
    links = geometry.links_mm.copy()
    links[-1] += geometry.probe_vector_mm
    lengths = np.linalg.norm(np.diff(skeleton, axis=1), axis=2)
    np.testing.assert_allclose(
        lengths,
        np.broadcast_to(np.linalg.norm(links, axis=1), lengths.shape),
        rtol=0,
        atol=RELATIVE * size_mm(geometry),
    )
    np.testing.assert_array_equal(
        skeleton[:, 0], np.broadcast_to(geometry.origin_mm, (5, 3))
    )


@given(st.lists(st.integers(0, 2600), max_size=6), st.booleans())
def test_cutting_a_stream_into_blocks_keeps_every_bit(cuts, in_columns):
    geometry = random_geometry(seed=4, n_joints=7)
    angles = postures(geometry, seed=5, n_samples=2600)
    centres, directions = probe_pose(geometry, angles)
    if in_columns:  # another layout in memory is no other data
        angles = np.asfortranarray(angles)
    parts = [probe_pose(geometry, block) for block in np.split(angles, sorted(cuts))]
    assert np.concatenate([p[0] for p in parts]).tobytes() == centres.tobytes()
    assert np.concatenate([p[1] for p in parts]).tobytes() == directions.tobytes()


def test_each_sample_alone_gives_the_bits_of_its_block():
    geometry = random_geometry(seed=8, n_joints=7)
    angles = postures(geometry, seed=9, n_samples=67)
    block = probe_centre(geometry, angles)
    one_by_one = [probe_centre(geometry, sample[np.newaxis]) for sample in angles]
    assert np.concatenate(one_by_one).tobytes() == block.tobytes()


def test_empty_block_gives_empty_results():
    geometry = random_geometry(seed=1, n_joints=3)
    centres, directions = probe_pose(geometry, np.empty((0, 3)))
    assert centres.shape == directions.shape == (0, 3)
    assert joint_positions(geometry, np.empty((0, 3))).shape == (0, 4, 3)


@pytest.mark.parametrize("shape", [(3,), (2, 2), (2, 4), (1, 2, 3)])
@pytest.mark.parametrize("of", [probe_pose, joint_positions])
def test_angles_of_another_number_of_joints_are_refused(of, shape):
    geometry = random_geometry(seed=1, n_joints=3)
    with pytest.raises(ValueError, match=r"expected \(n_samples, 3\)"):
        of(geometry, np.zeros(shape))


def test_angles_are_left_as_they_are():
    geometry = random_geometry(seed=1, n_joints=3)
    angles = postures(geometry, seed=2)
    angles.setflags(write=False)
    probe_pose(geometry, angles)


SPECIAL_RAD = (0.0, math.pi / 2, math.pi, -math.pi, 3 * math.pi, 1e-200, -1e-9, 1e4)


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=40))
def test_sines_and_cosines_of_tangents_are_those_of_the_angle(angles_rad):
    angles_rad = [*angles_rad, *SPECIAL_RAD]
    turns = JointRotations(np.array(angles_rad)[:, np.newaxis], np.zeros(1))
    for n, angle_rad in enumerate(angles_rad):
        assert abs(turns.sines[0, n] - math.sin(angle_rad)) < 1e-15
        assert abs(turns.cosines[0, n] - math.cos(angle_rad)) < 1e-15
        assert abs(turns.versines[0, n] - (1.0 - math.cos(angle_rad))) < 1e-15


def test_no_turn_is_exactly_none():
    turns = JointRotations(np.array([[1.25, -3.5]]), np.array([1.25, -3.5]))
    assert turns.sines.tolist() == [[0.0], [0.0]]
    assert turns.cosines.tolist() == [[1.0], [1.0]]
    assert turns.versines.tolist() == [[0.0], [0.0]]


def test_vector_is_turned_as_rodrigues_matrices_turn_it():
    rng = np.random.default_rng(3)
    axes = unit_vectors(rng.normal(size=(2, 3)))
    angles_rad = rng.uniform(-4, 4, (50, 2))
    vector = rng.normal(size=3)
    folded = BackwardRecursion(vector, JointRotations(angles_rad, np.zeros(2)))
    for joint in (1, 0):
        folded.turn(axes[joint], joint)
    for turned, sample_rad in zip(folded.vectors.T, angles_rad, strict=True):
        expected = vector
        for axis, angle_rad in zip(axes[::-1], sample_rad[::-1], strict=True):
            expected = matrix(axis, angle_rad) @ expected
        np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-14)


def matrix(axis, angle_rad):
    """Of the eigenvectors: the axis, and what is across turns in the complex plane."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    values, vectors = np.linalg.eig(angle_rad * skew)
    return (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real
