import asyncio
import signal
from collections.abc import Callable

import numpy as np
import pytest

from tests.end_to_end.agreement import assert_one_point_an_edge
from tests.end_to_end.listener import Listener, numbers
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.mosquitto import Mosquitto
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def outage(
    broker: Mosquitto, daemon: Program, listener: Listener, seconds: float
) -> None:
    """Kill the broker for a time; the listener is back before the daemon.

    Messages that the broker delivered but could not acknowledge are sent again.
    """
    listener.may_miss_acknowledgements = True
    broker.kill()
    await until(lambda: not listener.connected, "the listener has lost its broker")
    await daemon.says("broker.lost")
    await asyncio.sleep(seconds)
    daemon.process.send_signal(signal.SIGSTOP)
    broker.start()
    await until(lambda: listener.connected, "the listener is back")
    daemon.process.send_signal(signal.SIGCONT)
    await listener.event("broker.lost", active=False)


@pytest.mark.slow
async def test_points_and_scan_of_an_outage_arrive_afterwards_once_each(
    make_mosquitto: Callable[..., Mosquitto], bench: Workbench
) -> None:
    broker = make_mosquitto()
    bench.port = broker.port
    bench.write_simulator(SPHERE.format(points=4), top="repeat = true")
    bench.write_daemon()
    async with measuring(bench) as (listener, _, daemon):
        scan = await listener.start_scan(500.0)
        await listener.n_points(3)
        await outage(broker, daemon, listener, 3.0)
        n_taken = len(bench.presses())
        assert n_taken >= 8, "too few points for an outage that means anything"
        await listener.n_points(n_taken + 2)
        blocks = await listener.stop_scan(scan)
        assert listener.statuses[-1].online
    points = listener.points
    assert_one_point_an_edge(bench, points, bench.presses()[: len(points)])
    assert len(listener.events_of("broker.lost", active=True)) == 1
    seq = numbers(blocks)
    assert (np.diff(seq) > 0).all()
    # Sent but not arrived at a broker that was just dying: QoS 0 may lose that.
    assert (blocks[-1].total or 0) - len(seq) <= 5 * 25
    assert (blocks[-1].lost, blocks[-1].dropped) == (0, 0)
    assert listener.healths[-1].counters["reconnects"] == 1


@pytest.mark.slow
async def test_no_bound_of_memory_refuses_points_of_an_outage(
    make_mosquitto: Callable[..., Mosquitto], bench: Workbench
) -> None:
    broker = make_mosquitto()
    bench.port = broker.port
    bench.write_simulator(SPHERE.format(points=4), top="repeat = true")
    bench.write_daemon(capture="max_waiting_points = 3")
    async with measuring(bench) as (listener, simulator, daemon):
        await listener.n_points(2)
        await outage(broker, daemon, listener, 2.0)
        await listener.n_points(8)
        assert await simulator.stop() == 0
        await listener.event("device.lost", active=True)
        await listener.n_points(len(bench.presses()))
    assert listener.events_of("capture.refused") == []
    assert [p.seq for p in listener.points] == list(range(len(listener.points)))
    assert_one_point_an_edge(bench, listener.points, bench.presses())
