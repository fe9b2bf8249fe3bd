"""Turning vectors in place: against the sine, the cosine and another formula."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from traverse.kinematics.model.backward_recursion import (
    BackwardRecursion,
    JointRotations,
)
from traverse.kinematics.model.geometry import unit_vectors

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
