import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import seeds
from traverse.kinematics.model.geometry import unit_vectors
from traverse.kinematics.model.quaternion import (
    chain_rotations,
    conjugate,
    multiply,
    rotate,
    turn,
)

X, Y, Z = np.eye(3)
QUARTER = np.array([np.pi / 2])


def test_quarter_turns_by_hand():
    np.testing.assert_allclose(
        turn(Z, QUARTER)[:, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], rtol=1e-15
    )
    for axis, before, after in [(Z, X, Y), (X, Y, Z), (Y, Z, X)]:
        turned = rotate(turn(axis, QUARTER), before[:, np.newaxis])
        np.testing.assert_allclose(turned[:, 0], after, atol=1e-15)


def test_units_multiply_as_hamilton_wrote():
    one, i, j, k = np.eye(4)
    for left, right, product in [
        (i, j, k),
        (j, k, i),
        (k, i, j),
        (j, i, -k),
        (i, i, -one),
        (one, k, k),
    ]:
        np.testing.assert_array_equal(multiply(left, right), product)


@given(seeds, st.floats(-10, 10))
def test_rotation_agrees_with_rodrigues_formula(seed, angle):
    rng = np.random.default_rng(seed)
    axis, vector = unit_vectors(rng.normal(size=3)), rng.normal(size=3)
    expected = (
        np.cos(angle) * vector
        + np.sin(angle) * np.cross(axis, vector)
        + (1 - np.cos(angle)) * (axis @ vector) * axis
    )
    turned = rotate(turn(axis, np.array([angle])), vector[:, np.newaxis])
    np.testing.assert_allclose(turned[:, 0], expected, atol=1e-14)


@given(seeds)
def test_product_rotates_by_the_right_factor_first(seed):
    rng = np.random.default_rng(seed)
    p = turn(unit_vectors(rng.normal(size=3)), rng.uniform(-4, 4, 6))
    q = turn(unit_vectors(rng.normal(size=3)), rng.uniform(-4, 4, 6))
    vectors = rng.normal(size=(3, 6))
    np.testing.assert_allclose(
        rotate(multiply(p, q), vectors), rotate(p, rotate(q, vectors)), atol=1e-14
    )


@given(seeds)
def test_lengths_and_the_axis_stay(seed):
    rng = np.random.default_rng(seed)
    axis = unit_vectors(rng.normal(size=3))
    q = turn(axis, rng.uniform(-10, 10, 5))
    np.testing.assert_allclose(np.linalg.norm(q, axis=0), 1.0, rtol=1e-15)
    turned = rotate(q, axis[:, np.newaxis])
    np.testing.assert_allclose(turned, np.tile(axis[:, np.newaxis], 5), atol=1e-15)


@given(seeds)
def test_chains_go_outwards_and_conjugates_back(seed):
    rng = np.random.default_rng(seed)
    axes = unit_vectors(rng.normal(size=(7, 3))).T[:, :, np.newaxis]
    turns = turn(axes, rng.normal(scale=2.0, size=(7, 30)))
    rotations = chain_rotations(turns)
    vectors = rng.normal(size=(3, 7, 1))
    there = vectors[:, 0]
    for k in reversed(range(7)):
        there = rotate(turns[:, k], there)
    at_once = rotate(rotations[:, -1], vectors[:, 0])
    np.testing.assert_allclose(at_once, there, atol=1e-12)
    back = rotate(conjugate(rotations), rotate(rotations, vectors))
    np.testing.assert_allclose(back, np.broadcast_to(vectors, back.shape), atol=1e-12)
