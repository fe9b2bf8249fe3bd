"""Effects that need the stream do not depend on its division into blocks."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.effect_entries import (
    IDENTIFIED,
    MASSES,
    TEMPERATURE_C,
    N,
    counts_of,
    effect,
    everything,
)
from tests.daemon.pose.test_pipeline import probe_by_hand
from tests.daemon.values import SetClock, arm_model, count_samples, joined_poses, latch
from traverse.daemon.pose.pipeline import Pipeline
from traverse.protocol.messages import Quality


def flags(poses, row):
    return Quality.from_bits(int(poses.quality[row])).flags


@pytest.fixture(scope="module")
def full_model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"), MASSES + IDENTIFIED + everything())


@given(st.lists(st.integers(1, N - 1), max_size=6), st.integers(0, 1000))
@settings(max_examples=40)
def test_cutting_a_stream_into_blocks_changes_no_bit(full_model, cuts, seed):
    counts = counts_of(seed)
    samples = count_samples(counts)
    whole = Pipeline(full_model, SetClock()).poses(samples, TEMPERATURE_C)
    pipeline = Pipeline(full_model, SetClock())
    parts = [
        pipeline.poses(count_samples(counts[a:b], first=a), TEMPERATURE_C)
        for a, b in pairwise(sorted({0, *cuts, N}))
    ]
    joined = joined_poses(parts)
    for name in ("angles_rad", "xyz_mm", "ijk", "quality"):
        assert getattr(joined, name).tobytes() == getattr(whole, name).tobytes()


@pytest.mark.parametrize("row", [1, 30, N - 1])
@pytest.mark.parametrize("late", [0, 1])
def test_a_latch_is_corrected_like_a_sample_of_its_time(full_model, row, late):
    counts = counts_of()
    whole = Pipeline(full_model, SetClock()).poses(count_samples(counts), TEMPERATURE_C)
    pipeline = Pipeline(full_model, SetClock())
    pipeline.poses(count_samples(counts[: row + late]), TEMPERATURE_C)
    time_ns = int(whole.sample_time_ns[row])
    edge = latch(tuple(counts[row].tolist()), now_ns=time_ns + 400_000)
    assert edge.sample_time_ns == time_ns
    pose = pipeline.latched_pose(edge, TEMPERATURE_C)
    assert pose.xyz_mm.tobytes() == whole.xyz_mm[row].tobytes()
    assert pose.ijk.tobytes() == whole.ijk[row].tobytes()
    assert pose.quality == whole.quality[row]


def test_a_restart_forgets_the_motion_and_a_new_model_replaces_all_effects(tmp_path):
    model = arm_model(tmp_path, MASSES + effect("encoder_latency", latency_s=2e-3))
    pipeline = Pipeline(model, SetClock())
    counts = counts_of()
    pipeline.poses(count_samples(counts[:20]))
    pipeline.restart("base")
    after = pipeline.poses(count_samples(counts[20:40], first=20))
    assert [flags(after, row) for row in (0, 1)] == [("motion_unknown",), ()]
    grown = arm_model(tmp_path, MASSES + effect("thermal_expansion", expansion_per_c=1))
    pipeline.use_model(grown)
    poses = pipeline.poses(count_samples(counts[40:], first=40), 21.0)
    alone = Pipeline(grown, SetClock()).poses(
        count_samples(counts[40:], first=40), 21.0
    )
    assert poses.xyz_mm.tobytes() == alone.xyz_mm.tobytes()
    assert not poses.quality.any()
    place, _ = probe_by_hand(poses.angles_rad[-1])
    assert math.dist(poses.xyz_mm[-1], place) > 100.0
