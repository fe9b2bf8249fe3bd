"""Effects that need the stream do not depend on its division into blocks."""

import asyncio
import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.board_harness import BOARD, Bench
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
from traverse.drivers.base.values import DeviceUp, StreamStarted
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


def measured(model, seed, presses, read_ends, *, defers):
    """What measures, after a stream with presses that arrives in some reads."""

    async def measure():
        bench = Bench(model)
        bench.take(DeviceUp("base", BOARD, False), StreamStarted("base", 1, 100.0))
        counts, ends = counts_of(seed), [*sorted(read_ends), N]
        for row in range(N):
            end = next(end for end in ends if row < end)
            bench.measurement.dispatch(
                bench.device,
                count_samples(counts[row : row + 1], first=row),
                is_before_edge=defers and any(row <= press < end for press in presses),
            )
            if row in presses:
                now_ns = 10**12 + row * 10_000_000 + 3_000_000
                latched = tuple(counts[row].tolist())
                bench.take(latch(latched, token=row, now_ns=now_ns))
        bench.measurement.evaluate_readings()
        bench.device.driver.close()
        return bench

    return asyncio.run(measure())


@given(
    presses=st.sets(st.integers(0, N - 1), min_size=1, max_size=20),
    read_ends=st.sets(st.integers(1, N - 1), max_size=10),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40)
def test_no_point_depends_on_when_poses_are_computed(
    full_model, presses, read_ends, seed
):
    """Poses before an edge are deferred where both arrive together, at most 50 ms."""
    benches = [
        measured(full_model, seed, presses, read_ends, defers=defers)
        for defers in (False, True)
    ]
    once, later = (
        [point.model_dump(exclude={"session", "id"}) for point in bench.points]
        for bench in benches
    )
    assert once == later
    assert len(once) == len(presses)
    paths = [list(b.measurement.trajectory.between(0, 1 << 62)) for b in benches]
    one, other = map(joined_poses, paths)
    for name in ("sample_time_ns", "angles_rad", "xyz_mm", "ijk", "quality"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert len(paths[1]) <= len(paths[0])


async def test_poses_before_an_edge_wait_50_ms_and_no_longer(full_model):
    bench = Bench(full_model)
    bench.take(DeviceUp("base", BOARD, False), StreamStarted("base", 1, 100.0))
    counts, known = counts_of(), []
    for row in range(8):  # 10 ms apart
        samples = count_samples(counts[row : row + 1], first=row)
        bench.measurement.dispatch(bench.device, samples, is_before_edge=True)
        known.append(bench.measurement.trajectory.last_ns)
    bench.device.driver.close()
    assert known == [None] * 5 + [10**12 + 50_000_000] * 3
