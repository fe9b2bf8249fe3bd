"""Scans while the broker is away: complete, from the disk."""

from collections.abc import Callable

import pytest

from tests.daemon.store.outbox_entries import rows
from tests.end_to_end.listener import listening, numbers
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SWEEP, Workbench
from tests.mosquitto import Mosquitto
from traverse.protocol.messages import ResendArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


@pytest.mark.slow
async def test_a_complete_scan_has_every_point_after_an_outage(
    make_mosquitto: Callable[..., Mosquitto], bench: Workbench
) -> None:
    """More blocks than any queue holds wait for the broker."""
    broker = make_mosquitto()
    bench.port = broker.port
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon(scan='delivery = "complete"', capture="scan_block_s = 0.01")
    path = bench.folder / "state" / "scans.db"
    async with measuring(bench) as (listener, _, _):
        scan = await listener.start_scan(1000.0)
        await listener.scan_points(scan, 300)
        broker.kill()
        await until(lambda: not listener.connected, "the broker is gone")
        listener.statuses.clear()
        n = len(rows(path))
        await until(lambda: len(rows(path)) > n + 150, "blocks on the disk")
        broker.start()
        await until(lambda: listener.connected, "the broker is back")
        await listener.ready()
        total = (await listener.stop_scan(scan))[-1].total
        await until(
            lambda: len({*numbers(listener.scans).tolist()}) == total, "all points"
        )
        await until(lambda: all(sent for *_, sent in rows(path)), "all marked")
        health = listener.healths[-1]
        async with listening(bench.host, bench.port, bench.arm) as late:
            await late.ready()
            args = ResendArgs(scan=scan, from_seq=100, to_seq=399)
            answer = await late.command(args, "some of it")
            assert (answer.result or {})["total"] == total
            await until(
                lambda: {*range(100, 400)} <= {*numbers(late.scans).tolist()},
                "the points that were asked for",
            )
    firsts = [block.seq for block in listener.scans]
    once = list(dict.fromkeys(firsts))
    assert once == sorted(once)
    assert {block.dropped for block in listener.scans} == {0}
    assert health.counters["scan_blocks_dropped"] == 0
