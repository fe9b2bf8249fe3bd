"""Points that are requested again, and their retention."""

import pytest

from tests.daemon.store.outbox_entries import entries, rows
from tests.daemon.store.outbox_harness import OutboxOnLoop, numbers
from tests.end_to_end.programs import until
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.store.forwarder import MAX_RANGES


async def test_a_range_is_sent_again_with_the_same_bytes_behind_new_ones(bench):
    await bench.take_all(6)
    bench.send()
    answer = await bench.resend(session=bench.session.id, from_seq=2, to_seq=4)
    assert answer == {
        "session": bench.session.id,
        "from_seq": 2,
        "to_seq": 4,
        "points": 3,
        "first_seq": 0,
        "last_seq": 5,
    }
    await until(lambda: bench.queue.waiting("resend") == 3, "they are read")
    await bench.take_all(1)
    assert bench.send() == [*numbers("point", 6), *numbers("resend", 2, 3, 4)]


async def test_all_of_a_session_is_repeated_a_bounded_number_at_a_time(bench):
    await bench.take_all(700)
    bench.send()
    answer = await bench.resend(session=bench.session.id)
    assert (answer["points"], answer["to_seq"], answer["last_seq"]) == (700, None, 699)
    most, sent = 0, []

    def are_there() -> bool:
        nonlocal most
        most = max(most, bench.queue.waiting("resend"))
        sent.extend(bench.send(20))
        return len(sent) == 700

    await until(are_there, "all of them")
    assert sent == numbers("resend", *range(700))
    assert most <= 100


async def test_an_unknown_session_is_answered_with_nothing(bench):
    await bench.take_all(1)
    answer = await bench.resend(session="nobody", from_seq=3)
    assert (answer["points"], answer["first_seq"], answer["last_seq"]) == (
        0,
        None,
        None,
    )


async def test_without_a_session_it_tells_which_there_are(tmp_path):
    sessions = []
    for n in (2, 3):
        bench = OutboxOnLoop(tmp_path)
        async with bench.outbox.running():
            await bench.take_all(n)
            sessions.append(bench.session.id)
            answer = await bench.resend()
    assert answer["sessions"] == [
        {"session": sessions[0], "begun_ns": "1", "first_seq": 0, "last_seq": 1},
        {"session": sessions[1], "begun_ns": "1", "first_seq": 0, "last_seq": 2},
    ]


async def test_too_many_ranges_at_once_are_refused_with_what_to_do(bench):
    await bench.take_all(200)
    bench.send()
    for _ in range(MAX_RANGES):
        await bench.resend(session=bench.session.id)
    with pytest.raises(RequestRefusedError, match="ranges are being sent") as caught:
        await bench.resend(session=bench.session.id)
    assert caught.value.code == "resend.busy"
    await bench.send_until(1000)


async def test_old_points_go_by_themselves_and_the_unsent_stay(tmp_path):
    bench = OutboxOnLoop(tmp_path, keep_days=1.0)
    async with bench.outbox.running():
        old = [*entries("old", 3, time_ns=5), *entries("left", 2, time_ns=5)]
        bench.outbox._writer.query(lambda store: store.add(old), lambda _: None)
        bench.outbox._writer.query(
            lambda store: store.mark_sent([(1, 3)]), lambda _: None
        )
        bench.run_for_minutes()
        await until(
            lambda: [row[0] for row in rows(bench.path)] == ["left", "left"],
            "they are gone",
        )
        await until(lambda: "outbox.removed" in bench.codes(), "the event")
