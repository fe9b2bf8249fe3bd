"""Means of samples: the sums against NumPy on all samples, limits, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.values import PoseMaker, arm_file
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.points.averaging import (
    MAX_AVERAGING_NS,
    AverageLimits,
    SampleAverage,
)
from traverse.daemon.pose.arm_model import read_model
from traverse.protocol.messages import QualityFlag

START_NS, PERIOD_NS = 10**12, 10_000_000
WIDE = AverageLimits(speed_mm_s=1e9, spread_mm=1e9)


@pytest.fixture(scope="module")
def maker(tmp_path_factory):
    file = arm_file(tmp_path_factory.mktemp("arm"))
    return PoseMaker(read_model(file, {"base": None}), PERIOD_NS)


def blocks_of(maker, places_mm, cuts=(), quality=0):
    """Blocks with these places of the ball, cut where it is said."""
    n = len(places_mm)
    block = maker.block(range(n))
    rng = np.random.default_rng(3)
    ijk = np.array([0.0, 0.6, 0.8]) + 0.001 * rng.normal(size=(n, 3))
    whole = replace(
        block,
        xyz_mm=places_mm,
        ijk=ijk / np.linalg.norm(ijk, axis=1, keepdims=True),
        angles_rad=1.0 + 1e-4 * rng.normal(size=(n, 3)),
        counts=np.arange(3 * n).reshape(n, 3),
        quality=np.full(n, quality, np.uint32),
    )
    bounds = [0, *sorted(cuts), n]
    return whole, [whole.rows(slice(a, b)) for a, b in pairwise(bounds) if a < b]


@given(
    n=st.integers(2, 60),
    seed=st.integers(0, 2**32 - 1),
    cuts=st.lists(st.integers(1, 59), max_size=6),
)
def test_sums_are_those_of_all_samples_however_they_come(maker, n, seed, cuts):
    rng = np.random.default_rng(seed)
    places_mm = 1000.0 + rng.normal(size=(n, 3))
    whole, blocks = blocks_of(maker, places_mm, {c for c in cuts if c < n})
    average = SampleAverage(START_NS, n, None, WIDE)
    for block in blocks:
        assert not average.is_complete
        average.add(block)
    assert (average.is_complete, average.n) == (True, n)
    pose = average.pose()
    assert pose.xyz_mm == pytest.approx(places_mm.mean(axis=0), abs=1e-9)
    assert pose.angles_rad == pytest.approx(whole.angles_rad.mean(axis=0), abs=1e-12)
    expected = whole.ijk.mean(axis=0)
    assert pose.ijk == pytest.approx(expected / np.linalg.norm(expected), abs=1e-12)
    assert pose.counts.tolist() == whole.counts[-1].tolist()
    assert pose.sample_time_ns == START_NS + (n - 1) * PERIOD_NS // 2
    away_mm = np.linalg.norm(places_mm - places_mm.mean(axis=0), axis=1)
    spread_mm = np.sqrt(np.mean(away_mm**2))
    assert average.spread_mm == pytest.approx(spread_mm, rel=1e-6)
    if average.speed_mm_s is not None:
        times_s = np.arange(n) * PERIOD_NS * 1e-9
        slopes = np.polyfit(times_s, places_mm, 1)[0]
        assert average.speed_mm_s == pytest.approx(np.linalg.norm(slopes), rel=1e-5)


@pytest.mark.parametrize(
    ("samples", "dwell_ns", "numbers"),
    [
        (5, None, range(4, 9)),
        (None, 4 * PERIOD_NS, range(4, 8)),
        (None, 4 * PERIOD_NS - 1, range(4, 8)),
        (1, None, [4]),
    ],
)
def test_samples_count_from_the_instant_on_until_it_is_enough(
    maker, samples, dwell_ns, numbers
):
    average = SampleAverage(START_NS + 3 * PERIOD_NS + 1, samples, dwell_ns, WIDE)
    _, blocks = blocks_of(maker, np.arange(60.0).reshape(20, 3), cuts=(2, 6, 7))
    for block in blocks:
        average.add(block)
        average.add(block)  # what has been counted does not count again
    assert (average.is_complete, average.n) == (True, len(numbers))
    mean_mm = np.mean([np.arange(3 * i, 3 * i + 3) for i in numbers], axis=0)
    assert average.pose().xyz_mm == pytest.approx(mean_mm)


def complete(maker, places_mm, limits, **changes):
    average = SampleAverage(START_NS, len(places_mm), None, limits)
    average.add(blocks_of(maker, places_mm, **changes)[0])
    return average


def test_a_moving_arm_and_a_wide_spread_are_refused_with_their_sizes(maker):
    limits = AverageLimits(speed_mm_s=5.0, spread_mm=0.05)
    drifting = np.zeros((21, 3))
    drifting[:, 1] = np.linspace(0.0, 1.4, 21)  # in 0.2 s
    with pytest.raises(CaptureRefusedError, match=r"at 7 mm/s while.* is 5 mm/s"):
        complete(maker, drifting, limits).check()
    trembling = np.zeros((20, 3))
    trembling[::2, 2] = 0.2
    with pytest.raises(CaptureRefusedError, match=r"by 0.1 mm; the limit is 0.05"):
        complete(maker, trembling, limits).check()
    complete(maker, 0.1 * trembling, limits).check()
    moving = complete(maker, 0.1 * trembling, limits)
    moving.check_begin()
    moving.begin_speed_mm_s = 12.0
    with pytest.raises(CaptureRefusedError, match="12 mm/s when samples were to be"):
        moving.check_begin()


def test_samples_that_tell_no_place_are_refused_and_others_marked(maker):
    still = np.zeros((5, 3))
    bad = QualityFlag.ENCODER_ERROR | QualityFlag.INCOMPLETE
    with pytest.raises(CaptureRefusedError, match="encoder_error, incomplete"):
        complete(maker, still, WIDE, quality=bad.value).check()
    warm = complete(maker, still, WIDE, quality=QualityFlag.TEMPERATURE.value)
    warm.check()
    assert warm.pose().quality == QualityFlag.TEMPERATURE


def test_what_takes_too_long_is_refused_with_how_many_there_were(maker):
    average = SampleAverage(START_NS, 50, None, WIDE)
    average.add(maker.block(range(5)))
    last_ns = START_NS + 4 * PERIOD_NS
    average.refuse_if_over_time(last_ns + 1000, 1000)
    with pytest.raises(CaptureRefusedError, match="5 samples were averaged of 50"):
        average.refuse_if_over_time(last_ns + 1001, 1000)
    dwelling = SampleAverage(START_NS, None, PERIOD_NS, WIDE)
    with pytest.raises(CaptureRefusedError, match="0 samples"):
        dwelling.refuse_if_over_time(START_NS + PERIOD_NS + 1001, 1000)
    endless = SampleAverage(START_NS, 10**6, None, WIDE)
    endless.add(maker.block([0, 1], at=6000))
    with pytest.raises(CaptureRefusedError, match="2 samples were averaged of 1000000"):
        endless.refuse_if_over_time(START_NS + MAX_AVERAGING_NS + 1001, 1000)
