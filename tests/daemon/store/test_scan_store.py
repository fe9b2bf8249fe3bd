"""Scans on the event loop with the thread and the database of the spool."""

import contextlib
import sqlite3

from tests.daemon.store.outbox_entries import fill_disk, make_room, rows
from tests.daemon.store.scan_store_harness import POINTS, Bench, block
from tests.end_to_end.programs import until
from traverse.daemon.config.schema import ScanSection
from traverse.daemon.mqtt.outgoing_queue import MAX_SPOOLED
from traverse.daemon.store.scan_store import MAX_WAITING


async def test_a_live_scan_touches_no_disk(tmp_path):
    bench = Bench(tmp_path, delivery="live")
    async with bench.spool.running():
        assert await bench.offer(0, 1) == [True, True]
        assert bench.send() == [("scan", 0), ("scan", 1)]
        assert bench.spool.health() is None
    assert not bench.path.exists()


async def test_blocks_are_on_the_disk_before_they_are_sent_and_then_marked(tmp_path):
    bench = Bench(tmp_path)
    async with bench.spool.running():
        bench.spool.offer(block(0))
        assert bench.queue.next() is None
        await bench.spool.idle()
        assert rows(bench.path) == [("scan", 0, 0)]
        assert bench.send() == [("scan", 0)]
        await bench.all_marked()
        await until(lambda: bench.spool.health().blocks == 1, "health tells it")
        await until(lambda: bench.spool.health().unsent == 0, "health tells it")


async def test_what_the_broker_lacks_comes_in_order_however_much_it_is(tmp_path):
    """Far more blocks than the queue holds, then new ones behind them."""
    n = 3 * MAX_SPOOLED
    bench = Bench(tmp_path)
    async with bench.spool.running():
        for first in range(0, n, 50):
            assert all(await bench.offer(*range(first, first + 50)))
        assert bench.queue.waiting("spooled") == MAX_SPOOLED
        assert bench.queue.dropped["spooled"] == 0
        sent = await bench.send_all(n - 40)
        await bench.offer(n, last=True)
        sent += await bench.send_all(n + 1 - len(sent))
        await bench.all_marked()
    assert sent == [("scan", number) for number in range(n + 1)]
    assert bench.spool.counters == {"kept": n + 1}


async def test_a_next_run_sends_what_is_left_even_where_scans_are_live_now(tmp_path):
    first = Bench(tmp_path)
    async with first.spool.running():
        await first.offer(0, 1, 2)
    second = Bench(tmp_path, delivery="live")
    async with second.spool.running():
        assert await second.send_all(3) == [("scan", n) for n in range(3)]
        await second.all_marked()


async def test_delivery_changes_with_the_next_scan(tmp_path):
    bench = Bench(tmp_path, delivery="live")
    async with bench.spool.running():
        await bench.offer(0, scan="a")
        bench.spool.use(ScanSection(delivery="complete"))
        await bench.offer(1, scan="a")
        assert bench.send() == [("a", 0), ("a", 1)]
        await bench.offer(0, scan="b")
        assert await bench.send_all(1) == [("b", 0)]
        assert rows(bench.path)[0][0] == "b"


async def test_a_full_spool_drops_the_newest_counts_and_tells_it(tmp_path):
    bench = Bench(tmp_path, spool_mb=2.0)
    async with bench.spool.running():
        taken = []
        while not taken or taken[-1]:
            taken += await bench.offer(len(taken), points=1000)
        await until(lambda: bench.spool.health().unsent, "figures")
        n = len(taken) - 1
        assert bench.spool.counters == {"kept": n, "dropped": 1}
        assert bench.codes() == [("scan.spool_full", True)]
        assert bench.path.stat().st_size < 4e6
        await bench.send_all(n)
        await bench.all_marked()

        def has_room():
            bench.spool.poll()
            return bench.spool.offer(block(n + 1))

        await until(has_room, "what the broker has is forgotten")
        assert bench.codes() == [
            ("scan.spool_full", True),
            ("scan.spool_full", False),
        ]


async def test_too_many_blocks_on_their_way_to_the_disk_are_dropped(tmp_path):
    bench = Bench(tmp_path)
    async with bench.spool.running():
        taken = [bench.spool.offer(block(n)) for n in range(MAX_WAITING + 3)]
        assert taken == [True] * MAX_WAITING + [False] * 3
        await bench.spool.idle()
        assert len(rows(bench.path)) == MAX_WAITING
        assert bench.spool.counters["dropped"] == 3


async def test_what_the_disk_refuses_is_sent_all_the_same(tmp_path):
    bench = Bench(tmp_path)
    async with bench.spool.running():
        await bench.offer(0)
        assert bench.send() == [("scan", 0)]
        fill_disk(bench.path)
        await bench.offer(1, 2)
        await until(bench.codes, "an event")
        await bench.offer(3)
        assert bench.send() == [("scan", 1), ("scan", 2), ("scan", 3)]
        assert bench.spool.health().state == "failed"
        assert bench.codes() == [("scan.spool_failed", True)]
        make_room(bench.path)
        await until(lambda: len(bench.codes()) == 2, "it is over")
        await bench.offer(4)
        assert await bench.send_all(1) == [("scan", 4)]
    assert bench.spool.counters == {"kept": 2, "unkept": 3}
    assert bench.taken_back == []


async def test_what_neither_disk_nor_queue_takes_is_taken_back(tmp_path):
    bench = Bench(tmp_path)
    async with bench.spool.running():
        await bench.offer(*range(MAX_SPOOLED))
        fill_disk(bench.path)
        await bench.offer(MAX_SPOOLED)
        assert bench.taken_back == [("scan", POINTS)]
        assert bench.spool.counters["dropped"] == 1


async def test_a_damaged_file_gives_what_can_be_read_of_it(tmp_path):
    bench = Bench(tmp_path)
    async with bench.spool.running():
        await bench.offer(*range(30), points=200)
    with bench.path.open("r+b") as file:
        file.seek(file.seek(0, 2) // 2)
        file.write(b"\xff" * 9000)
    again = Bench(tmp_path)
    async with again.spool.running():
        await until(again.codes, "an event")
        assert again.codes()[0][0] == "scan.spool_replaced"
        n = len(rows(again.path))
        sent = await again.send_all(n)
    assert 0 < n < 30
    assert sent == sorted(set(sent))
    with contextlib.closing(sqlite3.connect(again.path)) as connection:
        assert connection.execute("PRAGMA quick_check").fetchone() == ("ok",)
