"""Poses of samples before an edge, computed later: no point depends on when."""

import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.effect_entries import IDENTIFIED, MASSES, N, counts_of, everything
from tests.daemon.values import arm_model, count_samples, joined_poses, latch
from traverse.drivers.base.values import DeviceUp, StreamStarted


@pytest.fixture(scope="module")
def full_model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"), MASSES + IDENTIFIED + everything())


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
                has_edges=defers and any(row <= press < end for press in presses),
            )
            if row in presses:
                now_ns = 10**12 + row * 10_000_000 + 3_000_000
                latched = tuple(counts[row].tolist())
                bench.take(latch(latched, token=row, now_ns=now_ns))
        bench.measurement.evaluate_readings()
        bench.device.driver.close()
        return bench

    return asyncio.run(measure())


@pytest.mark.slow
@given(
    presses=st.sets(st.integers(0, N - 1), min_size=1, max_size=20),
    read_ends=st.sets(st.integers(1, N - 1), max_size=10),
    seed=st.integers(0, 1000),
)
@settings(max_examples=8)
def test_no_point_depends_on_when_poses_are_computed(
    full_model, presses, read_ends, seed
):
    """Poses of samples that arrive with an edge wait for the usual batch."""
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
    first, other = map(joined_poses, paths)
    for name in ("sample_time_ns", "angles_rad", "xyz_mm", "ijk", "quality"):
        assert getattr(first, name).tobytes() == getattr(other, name).tobytes()
    assert len(paths[1]) <= len(paths[0])


async def test_poses_of_samples_with_an_edge_wait_for_the_usual_batch(full_model):
    bench = Bench(full_model)
    bench.take(DeviceUp("base", BOARD, False), StreamStarted("base", 1, 100.0))
    counts, known = counts_of(), []
    bench.device.delivery_queue.batch_window_ns = 50_000_000
    for row in range(8):  # 10 ms apart
        samples = count_samples(counts[row : row + 1], first=row)
        bench.measurement.dispatch(bench.device, samples, has_edges=True)
        known.append(bench.measurement.trajectory.last_ns)
    bench.device.driver.close()
    assert known == [None] * 4 + [10**12 + 40_000_000] * 4
