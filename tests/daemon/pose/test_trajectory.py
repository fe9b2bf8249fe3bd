"""What is remembered of the stream: speeds and places before and after an instant."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.values import PoseMaker, arm_model, count_samples, joined_poses
from traverse.daemon.pose.poses import ArmReadings
from traverse.daemon.pose.trajectory import (
    GAP_NS,
    KEPT_NS,
    SPEED_NS,
    TrajectoryBuffer,
    first_sample_beyond,
)
from traverse.protocol.messages import QualityFlag

PERIOD_NS = 1_000_000
START_NS = 10**12


@pytest.fixture
def maker(tmp_path):
    return PoseMaker(arm_model(tmp_path), PERIOD_NS)


def turning(block, speed_rad_s):
    elapsed_s = (block.sample_time_ns - START_NS) * 1e-9
    return replace(block, angles_rad=elapsed_s[:, np.newaxis] * speed_rad_s)


def readings_of(block):
    samples = replace(count_samples(block.counts), sample_time_ns=block.sample_time_ns)
    return ArmReadings(samples, block.counts, block.angles_rad, block.quality, None)


def filled(maker, n, size=7, **changes):
    """A path of n samples, a millisecond apart, whose joints turn at 1, 2, 3 rad/s."""
    path = TrajectoryBuffer()
    for first in range(0, n, size):
        block = maker.block(range(first, min(first + size, n)))
        block = replace(turning(block, np.array([1.0, 2.0, 3.0])), **changes)
        path.add(block)
        path.follow(readings_of(block))
    return path


@pytest.mark.parametrize("periods", [0.5, 20.0, 30.7, 49.0, 60.0])
def test_speeds_are_those_of_the_stream_before_an_instant(maker, periods):
    path = filled(maker, 50)
    time_ns = START_NS + int((periods + 10) * PERIOD_NS)
    angles_rad = (time_ns - START_NS) * 1e-9 * np.array([1.0, 2.0, 3.0])
    speeds_rad_s = path.speeds_rad_s(time_ns, angles_rad)
    assert speeds_rad_s == pytest.approx([1.0, 2.0, 3.0], rel=1e-9)


@pytest.mark.parametrize("size", [1, 3, 7, 40])
@pytest.mark.parametrize("invalid", [[], [4], [17, 18]])
def test_speeds_of_a_block_are_those_of_its_instants(maker, size, invalid):
    path = TrajectoryBuffer()
    turns = turning(maker.block(range(40)), np.array([1.0, -2.0, 0.5]))
    turns.angles_rad[:] += np.random.default_rng(3).normal(0, 1e-3, (40, 3))
    turns.quality[invalid] = QualityFlag.ENCODER_ERROR
    for first in range(0, 40, size):
        block = turns.rows(slice(first, first + size))
        path.follow(readings_of(block))
        speeds_rad_s = path.block_speeds_rad_s(readings_of(block))
        for row, speeds in enumerate(speeds_rad_s):
            at = int(block.sample_time_ns[row]), block.angles_rad[row]
            single = path.speeds_rad_s(*at)
            assert np.array_equal(speeds, single) or (
                single is None and np.isnan(speeds).all()
            )


def test_speeds_are_not_told_without_a_good_sample_a_moment_before(maker):
    angles_rad = np.zeros(3)
    assert TrajectoryBuffer().speeds_rad_s(START_NS, angles_rad) is None
    path = filled(maker, 50)
    assert path.speeds_rad_s(START_NS + SPEED_NS - 1, angles_rad) is None
    last_ns = START_NS + 49 * PERIOD_NS
    assert path.speeds_rad_s(last_ns + GAP_NS, angles_rad) is not None
    assert path.speeds_rad_s(last_ns + GAP_NS + 1, angles_rad) is None
    path.forget()
    assert path.speeds_rad_s(last_ns, angles_rad) is None
    bad = np.full(7, QualityFlag.ENCODER_ERROR.value, np.uint32)
    path = filled(maker, 49, quality=bad)
    assert path.speeds_rad_s(last_ns, angles_rad) is None


def test_places_away_are_the_last_before_and_the_first_after(maker):
    path = filled(maker, 50)  # the ball is at (i, i, i) mm at sample i
    at_mm = np.full(3, 25.0)
    instant_ns = START_NS + 25 * PERIOD_NS
    before_mm = path.last_position_beyond_mm(instant_ns, at_mm, 2.0)
    assert before_mm == pytest.approx([23.0] * 3)  # 3.5 mm off; at 24 it is 1.7 mm
    (whole,) = [joined_poses(list(path.between(0, START_NS * 2)))]
    time_ns, after_mm = first_sample_beyond(whole, instant_ns, at_mm, 2.0)
    assert (time_ns, after_mm.tolist()) == (START_NS + 27 * PERIOD_NS, [27.0] * 3)
    assert path.last_position_beyond_mm(instant_ns, at_mm, 100.0) is None
    assert first_sample_beyond(whole, instant_ns, at_mm, 100.0) is None


def test_what_is_older_than_a_while_is_forgotten(maker):
    slow = PoseMaker(maker.model, 10_000_000)
    path = TrajectoryBuffer()
    n = KEPT_NS // 10_000_000
    for first in range(0, 2 * n, 10):
        path.add(slow.block(range(first, first + 10)))
    far_mm = path.last_position_beyond_mm(
        START_NS + n * 10_000_000, np.full(3, 1e6), 1.0
    )
    assert far_mm[0] >= n - 10
    kept = list(path.between(START_NS, START_NS + 10**12))
    assert sum(len(block.seq) for block in kept) <= n + 10


def test_samples_between_two_times_come_whole(maker):
    path = filled(maker, 50)
    first_ns, last_ns = START_NS + 10 * PERIOD_NS, START_NS + 30 * PERIOD_NS
    numbers = [int(i) for block in path.between(first_ns, last_ns) for i in block.seq]
    assert numbers == list(range(10, 31))
    assert list(path.between(first_ns + 1, first_ns + 2)) == []
