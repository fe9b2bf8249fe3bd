"""The outbox on the event loop, with its thread and a real database."""

from tests.daemon.store.outbox_entries import rows
from tests.daemon.store.outbox_harness import OutboxOnLoop, numbers
from tests.end_to_end.programs import until
from tests.protocol.message_examples import POINT
from traverse.daemon.mqtt.outgoing_queue import MAX_POINTS
from traverse.daemon.store.forwarder import BATCH


async def test_a_point_is_on_the_disk_before_anybody_hears_of_it(bench):
    keeping = bench.take()
    heard = []
    keeping.on_settled(lambda: heard.append(rows(bench.path)))
    assert not keeping.is_settled
    assert bench.queue.next() is None
    await until(lambda: heard, "it is settled")
    assert heard == [[(bench.session.id, 0, 0)]]
    assert keeping.trouble is None
    assert bench.send() == numbers("point", 0)


async def test_what_the_broker_has_is_marked_and_nothing_else(bench):
    await bench.take_all(3)
    assert bench.send(2) == numbers("point", 0, 1)
    bench.outbox.poll()

    def sent():
        return [row[2] for row in rows(bench.path)]

    await until(lambda: sent() == [1, 1, 0], "two are marked")
    await until(lambda: bench.outbox.health().unsent == 1, "health knows")
    assert bench.outbox.health().points == 3
    assert bench.outbox.health().oldest_unsent_ns == POINT.time_ns


async def test_points_in_flight_share_commits_and_keep_their_order(bench):
    keepings = await bench.take_all(500)
    assert [k.point.seq for k in keepings] == [*range(500)]
    assert [row[1] for row in rows(bench.path)] == [*range(500)]
    assert bench.send() == numbers("point", *range(500))
    taken = bench.latencies["point_to_disk"]
    assert taken.figures().n == 500


async def test_points_are_offered_to_the_broker_before_anybody_else_hears(bench):
    keepings = [bench.take() for _ in range(20)]
    offered, waiting_when_settled = [], []
    for keeping in keepings:
        keeping.on_settled(
            lambda: waiting_when_settled.append(bench.queue.waiting("point"))
        )
    with bench.queue.notifying(lambda: offered.append(bench.queue.waiting("point"))):
        await until(lambda: len(waiting_when_settled) == 20, "all are settled")
    assert offered[-1] == 20
    assert all(
        waiting >= place + 1 for place, waiting in enumerate(waiting_when_settled)
    )


async def test_beyond_what_may_be_in_flight_no_point_is_taken(tmp_path):
    bench = OutboxOnLoop(tmp_path, limit=2)
    async with bench.outbox.running():
        keepings = [bench.take() for _ in range(3)]
        assert keepings[2] is None
        await until(lambda: keepings[1].is_settled, "room")
        assert (await bench.take_all(1))[0].point.seq == 2
    assert bench.take() is None  # it is closed


async def test_what_a_run_has_left_is_sent_first_by_the_next(tmp_path):
    first = OutboxOnLoop(tmp_path)
    async with first.outbox.running():
        await first.take_all(3)
        first.send(1)
    second = OutboxOnLoop(tmp_path)
    async with second.outbox.running():
        keeping = second.take()
        await until(lambda: keeping.is_settled, "a new one")
        assert await second.send_until(3) == numbers("point", 1, 2, 0)
    assert [row[2] for row in rows(second.path)] == [1, 1, 1, 1]


async def test_a_broker_that_is_away_costs_disk_and_no_memory(bench):
    n = 3 * MAX_POINTS
    await bench.take_all(n)
    assert bench.queue.waiting("point") == MAX_POINTS
    assert await bench.send_until(n) == numbers("point", *range(n))
    await bench.take_all(2)
    assert bench.send() == numbers("point", n, n + 1)  # from memory again
    bench.outbox.poll()
    await until(lambda: bench.outbox.health().unsent == 0, "all are marked")


async def test_points_that_come_while_others_are_read_keep_the_order(bench):
    await bench.take_all(MAX_POINTS + 5 * BATCH)
    sent = []
    for _ in range(40):
        sent += bench.send(50)
        await bench.take_all(3)
    sent += await bench.send_until(bench.session.next_seq - len(sent))
    assert sent == numbers("point", *range(bench.session.next_seq))
