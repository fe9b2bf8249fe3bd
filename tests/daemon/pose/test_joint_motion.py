from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.daemon.pose.joint_motion import GAP_NS, KEPT_NS, JointMotionTracker

MS = 1_000_000
FIELDS = ("speeds_rad_s", "are_speeds_known", "approaches")


def followed(times_ns, angles_rad, *, band_rad=0.01, are_valid=None, cuts=()):
    """The motion of one stream, passed to a trail block by block."""
    times_ns = np.asarray(times_ns, np.int64)
    angles_rad = np.asarray(angles_rad, float).reshape(len(times_ns), -1)
    if are_valid is None:
        are_valid = np.ones(len(times_ns), np.bool_)
    trail = JointMotionTracker(np.full(angles_rad.shape[1], band_rad))
    bounds = sorted({0, *cuts, len(times_ns)})
    parts = [
        trail.add(times_ns[a:b], angles_rad[a:b], are_valid[a:b])
        for a, b in pairwise(bounds)
    ]
    return trail, {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS
    }


def sense_by_turning_points(readings, band):
    """By hand: the furthest reading so far, and the distance back from it."""
    senses, sense, furthest = [], 0, readings[0]
    for reading in readings:
        if sense == 0:
            if 2 * abs(reading - furthest) > band:
                sense, furthest = (1 if reading > furthest else -1), reading
        elif sense * (furthest - reading) > band:
            sense, furthest = -sense, reading
        elif sense * (reading - furthest) > 0:
            furthest = reading
        senses.append(sense)
    return senses


@given(st.lists(st.integers(-6, 6), min_size=1, max_size=60), st.integers(1, 9))
def test_the_sense_turns_when_a_joint_has_come_back_by_the_band(steps, band):
    readings = np.cumsum(steps).astype(float)  # whole numbers: no rounding to differ
    times_ns = np.arange(len(readings)) * 10 * MS
    _, motion = followed(times_ns, readings, band_rad=float(band))
    assert motion["approaches"][:, 0].tolist() == sense_by_turning_points(
        readings, band
    )


def test_a_joint_that_trembles_within_its_band_keeps_its_sense():
    trembling = np.tile([0.0, 0.8], 50)
    readings = np.concatenate([np.linspace(-5, 0, 6), trembling])
    _, motion = followed(np.arange(106) * MS, readings, band_rad=1.0)
    assert motion["approaches"][0, 0] == 0  # it has not moved yet
    assert (motion["approaches"][1:] == 1).all()


def test_each_joint_has_its_own_sense():
    up = np.linspace(0, 1, 20)
    angles = np.column_stack([up, -up, 0 * up])
    _, motion = followed(np.arange(20) * MS, angles)
    assert motion["approaches"][-1].tolist() == [1, -1, 0]


def test_slow_streams_take_the_sample_before():
    times_ms = np.array([0, 10, 30, 35])
    _, motion = followed(times_ms * MS, [0.0, 0.1, 0.1, 0.0])
    assert motion["are_speeds_known"].tolist() == [False, True, True, True]
    assert motion["speeds_rad_s"][:, 0] == pytest.approx([0.0, 10.0, 0.0, -20.0])


def test_fast_streams_take_what_is_a_millisecond_older():
    times_ns = np.arange(40) * 100_000  # 10 kHz
    angle = 0.5 * 40.0 * (times_ns * 1e-9) ** 2  # 40 rad/s2
    _, motion = followed(times_ns, angle)
    # The mean speed of a millisecond is that in its middle.
    middle_s = times_ns * 1e-9 - np.minimum(times_ns * 1e-9, 1e-3) / 2
    assert motion["speeds_rad_s"][:, 0] == pytest.approx(40.0 * middle_s)


streams = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def stream(rng, n=120, *, rough=True):
    """Times, readings and validity, with gaps, steps back and broken counts."""
    steps_ns = rng.choice([100_000, 250_000, 3 * MS], n)
    are_valid = np.ones(n, np.bool_)
    if rough:
        odd = rng.random(n) < 0.05
        steps_ns[odd] = rng.choice([GAP_NS, GAP_NS + 1, 0, -5 * MS], odd.sum())
        are_valid = rng.random(n) > 0.03
    angles = np.cumsum(rng.normal(0, 0.01, (n, 3)), axis=0)
    return np.cumsum(steps_ns), angles, are_valid


@given(streams, st.lists(st.integers(1, 119), max_size=12))
def test_cutting_a_stream_changes_no_bit_of_the_motion(rng, cuts):
    times_ns, angles, are_valid = stream(rng)
    _, whole = followed(times_ns, angles, are_valid=are_valid)
    _, cut = followed(times_ns, angles, are_valid=are_valid, cuts=cuts)
    _, single = followed(times_ns, angles, are_valid=are_valid, cuts=range(120))
    for name in FIELDS:
        assert whole[name].tobytes() == cut[name].tobytes() == single[name].tobytes()


@given(streams, st.integers(1, 119))
def test_a_latch_has_the_motion_of_a_sample_however_late_it_comes(rng, row):
    times_ns, angles, _ = stream(rng, rough=False)
    _, motion = followed(times_ns, angles)
    at_once, _ = followed(times_ns[:row], angles[:row])
    late, _ = followed(times_ns, angles)
    for trail in (at_once, late):
        latched = trail.at_instant(int(times_ns[row]), angles[row])
        for name in FIELDS:
            expected = motion[name][row : row + 1]
            assert getattr(latched, name).tobytes() == expected.tobytes()


def test_a_latch_leaves_the_stream_where_it_is():
    times_ns, angles = np.arange(20) * MS, np.linspace(0, 1, 20)[:, np.newaxis]
    trail, motion = followed(times_ns[:10], angles[:10])
    trail.at_instant(int(times_ns[9]) + MS // 2, np.array([-7.0]))
    rest = trail.add(times_ns[10:], angles[10:], np.ones(10, np.bool_))
    _, whole = followed(times_ns, angles)
    for name in FIELDS:
        joined = np.concatenate([motion[name], getattr(rest, name)])
        assert joined.tobytes() == whole[name].tobytes()


@pytest.mark.parametrize("time_ns", [-1, 19 * MS + GAP_NS + 1])
def test_of_a_latch_outside_the_stream_nothing_is_known(time_ns):
    trail, _ = followed(np.arange(20) * MS, np.linspace(0, 1, 20))
    latched = trail.at_instant(time_ns, np.array([0.5]))
    assert not latched.are_speeds_known.any()
    assert not latched.approaches.any()


def test_before_the_first_sample_nothing_is_known():
    latched = JointMotionTracker(np.array([0.1])).at_instant(0, np.array([0.5]))
    assert not latched.are_speeds_known.any()
    assert not latched.approaches.any()


@pytest.mark.parametrize("step_ns", [GAP_NS + 1, 0, -MS])
def test_after_a_gap_all_is_unknown_until_there_is_motion(step_ns):
    times_ns = np.array([0, MS, 2 * MS, 2 * MS + step_ns, 3 * MS + step_ns])
    _, motion = followed(times_ns, [0.0, 0.1, 0.2, 0.3, 0.2])
    assert motion["are_speeds_known"].tolist() == [False, True, True, False, True]
    assert motion["approaches"][:, 0].tolist() == [0, 1, 1, 0, -1]


def test_a_count_that_is_not_valid_leaves_no_trace():
    are_valid = np.array([True, True, False, True, True])
    angles = [0.0, 0.1, -9.0, 0.2, 0.3]
    _, motion = followed(np.arange(5) * MS, angles, are_valid=are_valid)
    assert motion["are_speeds_known"].tolist() == [False, True, False, False, True]
    assert motion["approaches"][:, 0].tolist() == [0, 1, 0, 0, 1]


def test_no_more_is_kept_than_a_late_edge_can_need():
    times_ns = np.arange(0, 3 * KEPT_NS, 10 * MS)
    trail, _ = followed(times_ns, np.sin(times_ns), cuts=range(0, len(times_ns), 2))
    kept = sum(len(segment.times_ns) for segment in trail._past)
    assert KEPT_NS // (10 * MS) <= kept <= KEPT_NS // (10 * MS) + 3
