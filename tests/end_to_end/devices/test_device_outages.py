import asyncio

import numpy as np
import pytest

from tests.end_to_end.listener import Listener, numbers, times_ns
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, Workbench
from traverse.protocol.messages import Scan
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")
RATE_HZ = 500.0


async def start_scan(listener: Listener) -> str:
    scan = await listener.start_scan(RATE_HZ)
    await listener.scan_points(scan, 500)
    return scan


def assert_gap_is_the_outage(blocks: list[Scan], seconds: float) -> None:
    """One hole in the numbers, as long as the hole in time, and counted as lost."""
    seq, at_ns = numbers(blocks), times_ns(blocks)
    steps = np.diff(seq)
    hole = int(np.argmax(steps))
    assert (np.delete(steps, hole) == 1).all()
    assert steps[hole] > seconds * RATE_HZ
    away_s = (at_ns[hole + 1] - at_ns[hole]) * 1e-9
    assert steps[hole] == pytest.approx(away_s * RATE_HZ, abs=0.02 * RATE_HZ)
    assert blocks[-1].lost == steps[hole] - 1
    assert blocks[-1].total == seq[-1] + 1


@pytest.mark.slow
async def test_a_killed_board_leaves_the_right_gap_and_returns(
    bench: Workbench,
) -> None:
    bench.write_simulator(SPHERE.format(points=4))
    bench.write_daemon()
    async with measuring(bench) as (listener, simulator, daemon):
        scan = await start_scan(listener)
        await listener.n_points(2)
        await bench.kill_simulator(simulator)
        lost = await listener.event("device.lost", active=True)
        assert (lost.severity, lost.source) == ("error", "base")
        assert lost.remedy
        await until(lambda: listener.statuses[-1].state == "degraded", "degraded")
        assert listener.statuses[-1].drivers[0].state == "lost"
        await asyncio.sleep(3.0)
        n_before = len(listener.points)
        with bench.simulator("simulator-again") as repeated:
            await listener.event("device.lost", active=False)
            await listener.ready()
            await listener.n_points(n_before + 4)  # the whole script, from its start
            blocks = await listener.stop_scan(scan)
            await until(lambda: listener.healths[-1].devices[0].rate_hz > 0, "a rate")
            assert await repeated.stop() == 0
        assert "device.lost" in daemon.log
    assert_gap_is_the_outage(blocks, 3.0)
    assert [p.seq for p in listener.points] == list(range(len(listener.points)))
    assert len(listener.events_of("device.restarted")) == 1
    assert listener.healths[-1].counters["reconnects"] == 1


async def test_a_board_that_is_unplugged_for_a_while_goes_on(bench: Workbench) -> None:
    fault = '[[fault]]\nkind = "gone"\nat_s = 3.0\nduration_s = 1.2'
    bench.write_simulator(REST, faults=fault)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        scan = await start_scan(listener)
        await listener.event("device.lost", active=True)
        await listener.event("device.lost", active=False)
        after = max(int(s.seq) for s in listener.scans) + 800
        await listener.scan_points(scan, after)
        blocks = await listener.stop_scan(scan)
    assert_gap_is_the_outage(blocks, 1.1)
