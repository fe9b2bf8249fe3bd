"""Rotations in few calls are those of `quaternion`, bit for bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from traverse.kinematics.model.batched_quaternions import (
    chain_rotations,
    composed,
    conjugate,
    rotated,
)
from traverse.kinematics.model.quaternion import multiply, rotate, turn


def turns_of(seed, n_joints, n_samples):
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(3, n_joints, 1))
    axes /= np.linalg.norm(axes, axis=0)
    return turn(axes, rng.normal(scale=2.0, size=(n_joints, n_samples)))


sizes = given(st.integers(0, 10**6), st.integers(1, 9), st.integers(1, 70))
unhurried = settings(deadline=None)


@unhurried
@sizes
def test_chains_and_products_are_those_of_one_after_the_other(seed, n_joints, n):
    turns = turns_of(seed, n_joints, n)
    by_hand = [turns[:, 0]]
    for k in range(1, n_joints):
        by_hand.append(multiply(by_hand[-1], turns[:, k]))
    assert chain_rotations(turns).tobytes() == np.stack(by_hand, axis=1).tobytes()
    others = turns_of(seed + 1, n_joints, n)
    assert composed(turns, others).tobytes() == multiply(others, turns).tobytes()


@unhurried
@sizes
def test_vectors_are_turned_alike_one_for_all_or_one_each(seed, n_joints, n):
    turns = turns_of(seed, n_joints, n)
    rng = np.random.default_rng(seed)
    for shape in ((3, n_joints, n), (3, n_joints, 1), (3, 1, 1)):
        vectors = rng.normal(size=shape)
        there = rotated(turns, vectors)
        assert there.tobytes() == rotate(turns, vectors).tobytes()
        back = rotated(conjugate(turns), there)
        assert back == pytest.approx(np.broadcast_to(vectors, back.shape), abs=1e-12)


def test_a_samples_bits_do_not_depend_on_its_neighbours():
    turns = turns_of(3, 7, 300)
    whole = chain_rotations(turns)
    alone = [chain_rotations(turns[:, :, i : i + 1].copy()) for i in range(300)]
    assert np.concatenate(alone, axis=2).tobytes() == whole.tobytes()
