import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.model.readings import (
    Encoders,
    Unwrapper,
    counts_to_angles,
    encoders_from_arm,
)


def one_encoder(counts_per_turn, sign=1, zero_rad=0.0):
    return Encoders(np.array([counts_per_turn]), np.array([sign]), np.array([zero_rad]))


def column(*counts):
    return np.array(counts, dtype=np.int64)[:, np.newaxis]


counts_per_turns = st.one_of(
    st.integers(1, 40), st.sampled_from([2**23, 2**32 - 1, 2**32, 10**9 + 7])
)


@st.composite
def walks(draw):
    """Two encoders and true counts over many turns, steps below half a turn."""
    turns = draw(st.lists(counts_per_turns, min_size=2, max_size=2))
    n_samples = draw(st.integers(1, 30))
    columns = []
    for counts_per_turn in turns:
        start = draw(st.integers(-(counts_per_turn // 2), (counts_per_turn - 1) // 2))
        step = st.integers(-(counts_per_turn // 2), (counts_per_turn - 1) // 2)
        steps = draw(st.lists(step, min_size=n_samples - 1, max_size=n_samples - 1))
        columns.append(np.cumsum([start, *steps]))
    return np.array(turns), np.stack(columns, axis=1)


@given(walks(), st.lists(st.integers(0, 30), max_size=4))
def test_unwrapping_follows_the_true_counts_whatever_the_blocks(walk, cuts):
    counts_per_turn, true_counts = walk
    unwrapper = Unwrapper(Encoders(counts_per_turn, np.ones(2), np.zeros(2)))
    raw = (true_counts % counts_per_turn).astype(np.uint32)
    blocks = [unwrapper.unwrap(block) for block in np.split(raw, sorted(cuts))]
    np.testing.assert_array_equal(np.concatenate(blocks), true_counts)


@pytest.mark.parametrize(
    ("counts_per_turn", "raw", "expected"),
    [
        (1000, [100, 600], [100, -400]),  # exactly half a turn: downwards
        (1001, [100, 600], [100, 600]),  # 500 of 1001 is less than half
        (1001, [100, 601], [100, -400]),  # 501 of 1001 is more
        (2**32, [0, 2**31], [0, -(2**31)]),
        (2**32, [0, 2**31 - 1, 2**32 - 2], [0, 2**31 - 1, 2**32 - 2]),
        (2, [0, 1, 0], [0, -1, -2]),
        (1, [0, 0], [0, 0]),
    ],
)
def test_half_a_turn_is_taken_downwards(counts_per_turn, raw, expected):
    unwrapped = Unwrapper(one_encoder(counts_per_turn)).unwrap(column(*raw))
    np.testing.assert_array_equal(unwrapped[:, 0], expected)


@given(
    counts_per_turns,
    st.sampled_from([1, -1]),
    st.floats(-20, 20),
    st.integers(0, 2**32 - 1),
)
def test_first_sample_takes_the_turn_nearest_zero(counts_per_turn, sign, zero, raw):
    encoders = one_encoder(counts_per_turn, sign, zero)
    unwrapped = Unwrapper(encoders).unwrap(column(raw))
    assert (unwrapped[0, 0] - raw) % counts_per_turn == 0
    angle = counts_to_angles(encoders, unwrapped)[0, 0]
    assert abs(angle - zero) <= np.pi * (1 + 1e-9)


def test_counts_latched_at_an_edge_do_not_move_the_stream():
    unwrapper = Unwrapper(one_encoder(1000))
    assert unwrapper.near(np.array([990])).tolist() == [-10]
    unwrapper.unwrap(column(100, 500, 900))
    assert unwrapper.near(np.array([10])).tolist() == [1010]
    assert unwrapper.near(np.array([300])).tolist() == [1300]
    assert unwrapper.near(np.array([890])).tolist() == [890]
    assert unwrapper.unwrap(column(950)).tolist() == [[950]]


def test_returned_block_does_not_hold_the_state():
    unwrapper = Unwrapper(one_encoder(1000))
    unwrapper.unwrap(column(100))[:] = 700
    assert unwrapper.unwrap(column(200)).tolist() == [[200]]


def test_empty_block_changes_nothing():
    unwrapper = Unwrapper(one_encoder(1000))
    assert unwrapper.unwrap(np.empty((0, 1), dtype=np.uint32)).shape == (0, 1)
    unwrapper.unwrap(column(900, 100))
    unwrapper.unwrap(np.empty((0, 1), dtype=np.uint32))
    assert unwrapper.unwrap(column(300)).tolist() == [[300]]


def test_counts_become_angles_with_sign_and_resolution():
    encoders = Encoders(np.array([4, 2**32]), np.array([1, -1]), np.zeros(2))
    angles = counts_to_angles(encoders, np.array([[1, 2**31], [-6, 1]]))
    expected = [[np.pi / 2, -np.pi], [-3 * np.pi, -2 * np.pi / 2**32]]
    np.testing.assert_allclose(angles, expected, rtol=1e-15)


def test_encoders_come_from_the_arm_file():
    encoders = encoders_from_arm(parse_arm(ARM_TEXT))
    assert encoders.counts_per_turn.tolist() == [2**23, 2**32]
    assert encoders.signs.tolist() == [1, -1]
    assert encoders.zeros_rad.tolist() == [1.234, -0.5]


def test_joints_without_encoder_are_named():
    text = re.sub(r"\[joints\.encoder\]\n(\w+ = .*\n){3}", "", ARM_TEXT)
    with pytest.raises(ValueError, match="no encoder for J1, J2"):
        encoders_from_arm(parse_arm(text))


@pytest.mark.parametrize(
    ("counts_per_turn", "signs", "zeros_rad", "expected"),
    [
        ([0], [1], [0.0], "counts_per_turn"),
        ([2**32 + 1], [1], [0.0], "counts_per_turn"),
        ([8], [2], [0.0], "signs"),
        ([8, 8], [1], [0.0], "shapes"),
        ([8], [1], [1e300], "zeros_rad"),
        ([8], [1], [np.nan], "zeros_rad"),
    ],
)
def test_impossible_encoders_are_refused(counts_per_turn, signs, zeros_rad, expected):
    with pytest.raises(ValueError, match=expected):
        Encoders(np.array(counts_per_turn), np.array(signs), np.array(zeros_rad))


def test_counts_of_another_number_of_joints_are_refused():
    unwrapper = Unwrapper(one_encoder(1000))
    with pytest.raises(ValueError, match="with 1 joint"):
        unwrapper.unwrap(np.zeros((4, 2), dtype=np.int64))
    with pytest.raises(ValueError, match="n_joints"):
        unwrapper.near(np.zeros((1, 1), dtype=np.int64))


def test_turns_of_some_encoders_are_forgotten_and_those_of_others_kept():
    unwrapper = Unwrapper(Encoders(np.array([1000, 1000]), np.ones(2), np.zeros(2)))
    counts = np.array([[0, 0], [400, 400], [800, 800], [200, 200]])
    assert unwrapper.unwrap(counts)[-1].tolist() == [1200, 1200]
    unwrapper.reset(np.array([False, True]))
    assert unwrapper.near(counts[-1]).tolist() == [1200, 200]
    assert unwrapper.unwrap(counts[-1:]).tolist() == [[1200, 200]]
    unwrapper.reset()
    assert unwrapper.unwrap(counts[-1:]).tolist() == [[200, 200]]
