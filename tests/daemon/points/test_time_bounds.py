"""How far the time of a point may be off, as it states itself."""

import asyncio
from dataclasses import replace

import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.points.test_latched_edges import (
    BUSY_NS,
    EDGE_NS,
    LATCH_NS,
    QUIET_NS,
    latched_counts,
    point_of,
)
from tests.daemon.two_devices import BEGIN_NS, base, wrist
from traverse.daemon.executor import AwaitLatch
from traverse.protocol.messages import PointArgs


def take(bench, numbers, *, base_ns, wrist_ns, speed=0.0):
    """Let both devices read, each with what its clock leaves open."""
    readers = (wrist(rate_hz=100.0, speed=speed), base(speed=speed))
    for reader, bound_ns in zip(readers, (wrist_ns, base_ns), strict=True):
        bench.take(replace(reader.samples(numbers), time_bound_ns=bound_ns))
    bench.clock.now_ns = BEGIN_NS + numbers[-1] * 10_000_000


@pytest.fixture
async def bench(tmp_path):
    bench = ArmBench(tmp_path)
    bench.up()
    yield bench
    bench.close()


@pytest.mark.parametrize("bound_ns", [QUIET_NS, BUSY_NS])
async def test_a_latched_press_states_what_its_latch_had(tmp_path, bound_ns):
    assert point_of(tmp_path, bound_ns).time_bound_ns == bound_ns


async def test_what_states_nothing_itself_is_bounded_as_its_driver_states_for_all(
    tmp_path,
):
    """So do lines of text without a time of their own."""
    point = point_of(tmp_path, 0, latches=False, jitter_ns=BUSY_NS)
    assert point.time_bound_ns == BUSY_NS
    # Its place is as uncertain as with that bound.
    same = point_of(tmp_path, BUSY_NS, latches=False)
    assert point.covariance_mm2 == same.covariance_mm2
    assert point_of(tmp_path, 0, latches=False, jitter_ns=0).time_bound_ns is None


async def test_a_latch_by_command_states_it_too(tmp_path):
    bench = ArmBench(tmp_path)
    bench.up()
    counts = latched_counts(EDGE_NS)
    take(bench, range(30), base_ns=QUIET_NS, wrist_ns=QUIET_NS, speed=1.0)
    answer = AwaitLatch(5).execute(bench.measurement)
    latch = edge("base", EDGE_NS, 5, counts=counts, time_bound_ns=BUSY_NS)
    bench.take(replace(latch, input=None))
    await asyncio.sleep(0)
    assert answer.result().time_bound_ns == BUSY_NS
    bench.close()


@pytest.mark.parametrize(
    ("base_ns", "wrist_ns", "edge_ns", "stated_ns"),
    [
        (3_000_000, 1_000_000, 400_000, 3_000_000),
        (1_000_000, 3_000_000, 400_000, 3_000_000),
        (1_000_000, 1_000_000, 4_000_000, 4_000_000),
    ],
)
async def test_of_several_devices_the_greatest_counts(
    bench, base_ns, wrist_ns, edge_ns, stated_ns
):
    take(bench, range(30), base_ns=base_ns, wrist_ns=wrist_ns)
    bench.take(edge("handle", EDGE_NS, 7, time_bound_ns=edge_ns))
    (point,) = bench.points
    assert point.time_bound_ns == stated_ns


async def test_a_point_by_command_is_bounded_by_the_readings_around_it(bench):
    take(bench, range(30), base_ns=BUSY_NS, wrist_ns=QUIET_NS)
    asking = asyncio.ensure_future(bench.point_requests.take_point(PointArgs()))
    await asyncio.sleep(0)
    take(bench, range(30, 40), base_ns=LATCH_NS, wrist_ns=LATCH_NS)
    await asking
    (point,) = bench.points
    assert point.time_bound_ns == BUSY_NS


async def test_a_mean_states_the_greatest_of_its_samples(bench):
    take(bench, range(30), base_ns=BUSY_NS, wrist_ns=QUIET_NS)
    asked_for = PointArgs(samples=40)
    asking = asyncio.ensure_future(bench.point_requests.take_point(asked_for))
    await asyncio.sleep(0)
    bounds_ns = (QUIET_NS, 7_000_000, QUIET_NS, QUIET_NS, 9_000_000)
    for begin, bound_ns in zip(range(30, 80, 10), bounds_ns, strict=True):
        numbers = range(begin, begin + 10)
        take(bench, numbers, base_ns=bound_ns, wrist_ns=QUIET_NS)
    await asking
    (point,) = bench.points
    assert point.samples == 40
    assert point.time_bound_ns == 7_000_000
