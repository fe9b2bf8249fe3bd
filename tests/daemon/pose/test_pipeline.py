import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.values import (
    MODULI,
    SetClock,
    arm_model,
    count_samples,
    joined_poses,
    latch,
)
from traverse.daemon.pose.pipeline import QUALITY_OF_STATUS, Pipeline
from traverse.protocol.messages import Quality

TURNS = (65536, 1048576, 8388608)  # of the joints
SIGNS = (1, -1, 1)
ZEROS = (1.234, -0.5, 0.25)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


def rotation(axis, angle):
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew


def probe_by_hand(readings):
    """x_0 + sum P_k r_k for the arm of these tests, with matrices."""
    axes = ((0, 0, 1), (0, 1, 0), (1, 0, 0))
    links = ((0, 10, 250), (0, 0, 300), (0, 20, 250))  # the probe's 50 mm included
    place, turned = np.array([1.0, -2.0, 3.5]), np.eye(3)
    for axis, link, reading, zero in zip(axes, links, readings, ZEROS, strict=True):
        turned = turned @ rotation(axis, reading - zero)
        place = place + turned @ link
    return place, turned @ [0, 0, 1]


def reading_by_hand(joint, count):
    """The reading of a first count: the turn nearest to the zero."""
    raw = SIGNS[joint] * 2 * math.pi * count / TURNS[joint]
    turns = round((ZEROS[joint] - raw) / (2 * math.pi))
    return raw + 2 * math.pi * turns


def moved(seed, n):
    """Counts (n, 3 channels) of joints that turn several times over."""
    rng = np.random.default_rng(seed)
    channel_turns = np.array([1048576, 8388608, 65536])
    steps = rng.uniform(-0.2, 0.3, (n, 3)) * channel_turns
    return (np.cumsum(steps, axis=0).astype(np.int64)) % np.array(MODULI)


@given(st.tuples(*(st.integers(0, modulus - 1) for modulus in MODULI)))
def test_a_latch_gives_the_pose_computed_by_matrices(model, counts):
    pose = Pipeline(model, SetClock()).latched_pose(latch(counts))
    readings = [reading_by_hand(j, counts[c]) for j, c in enumerate((2, 0, 1))]
    assert np.allclose(
        np.cos(pose.angles_rad - readings), 1
    )  # half a turn from the zero both ways are equally near
    place, shank = probe_by_hand(readings)
    assert np.allclose(pose.xyz_mm, place, atol=1e-9)
    assert np.allclose(pose.ijk, shank, atol=1e-12)


def test_a_stream_over_many_turns_gives_the_poses_computed_by_matrices(model):
    counts = moved(1, 400)
    poses = Pipeline(model, SetClock()).poses(count_samples(counts))
    angles = poses.angles_rad
    assert np.abs(np.diff(angles, axis=0)).max() < 0.31 * 2 * math.pi  # no jumps
    assert np.ptp(angles, axis=0).min() > 2 * math.pi
    for row in (0, 57, 399):
        place, shank = probe_by_hand(angles[row])
        assert np.allclose(poses.xyz_mm[row], place, atol=1e-9)
        assert np.allclose(poses.ijk[row], shank, atol=1e-12)
        for joint, channel in enumerate((2, 0, 1)):
            expected = SIGNS[joint] * 2 * math.pi * counts[row, channel] / TURNS[joint]
            turns = (angles[row, joint] - expected) / (2 * math.pi)
            assert turns == pytest.approx(round(turns), abs=1e-6)


@given(st.lists(st.integers(1, 99), max_size=6), st.integers(0, 1000))
def test_cutting_a_stream_into_blocks_changes_no_bit(model, cuts, seed):
    counts = moved(seed, 100)
    whole = Pipeline(model, SetClock()).poses(count_samples(counts))
    pipeline, bounds = Pipeline(model, SetClock()), sorted({0, *cuts, 100})
    parts = [
        pipeline.poses(count_samples(counts[a:b], first=a)) for a, b in pairwise(bounds)
    ]
    joined = joined_poses(parts)
    for name in ("seq", "sample_time_ns", "counts", "angles_rad", "xyz_mm", "ijk"):
        assert getattr(joined, name).tobytes() == getattr(whole, name).tobytes()


def test_a_latch_takes_the_turn_of_the_stream_and_leaves_it_alone(model):
    counts = moved(2, 200)
    pipeline = Pipeline(model, SetClock())
    last = pipeline.poses(count_samples(counts[:150])).counts[-1]
    near = (counts[149] + 5) % np.array(MODULI)
    pose = pipeline.latched_pose(latch(tuple(near.tolist())))
    assert (pose.counts - last).tolist() == [5, 5, 5]
    after = pipeline.poses(count_samples(counts[150:], first=150))
    whole = Pipeline(model, SetClock()).poses(count_samples(counts))
    assert after.counts.tolist() == whole.counts[150:].tolist()


def test_after_a_restart_the_turns_are_those_nearest_to_the_zero(model):
    pipeline = Pipeline(model, SetClock())
    pipeline.poses(count_samples(moved(1, 400)))
    pipeline.restart("base")
    afresh = pipeline.poses(count_samples(moved(1, 1)))
    first = Pipeline(model, SetClock()).poses(count_samples(moved(1, 1)))
    assert afresh.counts.tolist() == first.counts.tolist()


def test_status_bits_become_quality_flags_of_the_joints_channels_only(model):
    samples = count_samples(moved(3, 6))
    status = np.zeros((6, 4), np.uint8)
    status[1, 2], status[2, 0], status[3, 1], status[4] = 1, 2, 4 | 8, (16, 0, 1, 0)
    status[5, 3] = 0xFF  # a channel that belongs to no joint
    counts = np.hstack([samples.counts, np.zeros((6, 1), np.uint32)])
    poses = Pipeline(model, SetClock()).poses(
        replace(samples, counts=counts, status=status)
    )
    flags = [Quality.from_bits(int(bits)).flags for bits in poses.quality]
    assert flags == [
        (),
        ("encoder_error",),
        ("encoder_warning",),
        ("late", "stale"),
        ("encoder_error", "incomplete"),
        (),
    ]
    pose = Pipeline(model, SetClock()).latched_pose(latch((1, 2, 3), status=(0, 4, 0)))
    assert Quality.from_bits(pose.quality) == Quality(ok=False, flags=("late",))


def test_every_status_byte_has_its_quality():
    for status, bits in enumerate(QUALITY_OF_STATUS.tolist()):
        flags = set(Quality.from_bits(bits).flags)
        assert ("encoder_error" in flags) == bool(status & 1)
        assert ("encoder_warning" in flags) == bool(status & 2)
        assert ("late" in flags) == bool(status & 4)
        assert ("stale" in flags) == bool(status & 8)
        assert ("incomplete" in flags) == bool(status & 16)
        assert ("time_uncertain" in flags) == bool(status & 64)
