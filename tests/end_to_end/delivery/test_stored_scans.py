"""Scans of a real daemon in a store whose member and broker die meanwhile."""

from collections.abc import Callable

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.end_to_end.listener import times_ns
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SWEEP, Workbench
from tests.fleet.running import becomes, rows, started
from tests.mosquitto import Mosquitto
from traverse.testing.waiting import until

pytestmark = [pytest.mark.needs("mosquitto"), pytest.mark.slow]


async def test_what_died_with_the_broker_is_requested_from_the_arm(
    make_mosquitto: Callable[..., Mosquitto], bench: Workbench
) -> None:
    broker = make_mosquitto()
    bench.port = broker.port
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon(scan='delivery = "complete"', capture="scan_block_s = 0.01")
    async with measuring(bench) as (listener, _, _):
        async with started(bench.folder, broker) as member:
            await member.says("connected to")
            scan = await listener.start_scan(500.0)
            await listener.scan_points(scan, 200)
        n = len(listener.scans)  # the member was killed
        await until(lambda: len(listener.scans) > n + 50, "blocks that wait for it")
        broker.kill()  # with them
        broker.start()
        await until(lambda: listener.connected, "the broker is back")
        listener.statuses.clear()
        await listener.ready()
        async with started(bench.folder, broker) as member:
            total = (await listener.stop_scan(scan))[-1].total
            await becomes(
                bench.folder,
                f"SELECT sum(points), max(total) FROM scan_block WHERE scan = '{scan}'",
                [(total, total)],
            )
            assert await member.stop() == 0
    assert rows(bench.folder, "SELECT * FROM lost") == []
    assert "0 dropped" in member.lines[-1]
    assert ", 0 gaps asked for" not in member.lines[-1]
    files = [file for (file,) in rows(bench.folder, "SELECT file FROM scan_block")]
    tables = [
        pq.read_table(bench.folder / "traverse-scans" / file) for file in {*files}
    ]
    number = np.concatenate([table["number"] for table in tables])
    order = np.unique(number, return_index=True)[1]
    np.testing.assert_array_equal(number[order], np.arange(total))
    time_ns = np.concatenate([table["time_ns"] for table in tables])[order]
    heard = {block.seq: block for block in listener.scans}
    np.testing.assert_array_equal(
        time_ns[np.isin(time_ns, times_ns([*heard.values()]))],
        np.sort(times_ns([*heard.values()])),
    )
