"""What senders of commands cannot do: flood, misdirect answers, write the log."""

import asyncio
import logging

import pytest

from tests.daemon.commands.test_dispatcher import Bench, command
from traverse.daemon.commands.dispatcher import MAX_CORRELATION_BYTES
from traverse.daemon.commands.rate_limit import (
    ALL,
    FLOOD,
    FLOOD_END_S,
    LOG_LINES,
    OF_KIND,
    OTHERS,
    PAUSE_S,
)
from traverse.protocol.messages import COMMANDS, Reply
from traverse.testing.waiting import until


@pytest.fixture
async def bench():
    bench = Bench()
    yield bench
    await bench.desk.close()


def codes(replies: list[Reply]) -> list[str]:
    return ["ok" if reply.ok else reply.error.code for reply in replies]


async def settled(bench) -> None:
    for _ in range(20):
        await asyncio.sleep(0)


async def send_at_once(bench, n, name="point", first=0) -> None:
    for k in range(first, first + n):
        bench.receive(command(f"r{k}"), name)
        await settled(bench)


async def test_so_many_points_at_once_and_then_so_many_a_second(bench):
    limit = OF_KIND["point"]
    await send_at_once(bench, limit.at_once + 5)
    replies = await bench.replies(limit.at_once + 5)
    assert codes(replies) == ["ok"] * limit.at_once + ["command.too_many"] * 5
    bench.clock.go_on_s(1.0)
    before = len(bench.carried_out)
    await send_at_once(bench, 80, first=1000)
    assert len(bench.carried_out) - before == limit.rate_hz


async def test_a_command_beyond_the_limit_may_be_sent_again(bench):
    limit = OF_KIND["point"]
    await send_at_once(bench, limit.at_once + 1)
    bench.clock.go_on_s(1.0)
    bench.receive(command(f"r{limit.at_once}"))
    replies = await bench.replies(limit.at_once + 2)
    assert codes(replies)[-2:] == ["command.too_many", "ok"]


async def test_an_answer_that_is_remembered_needs_no_permission(bench):
    limit = OF_KIND["point"]
    await send_at_once(bench, limit.at_once + 1)
    bench.receive(command("r0"))
    replies = await bench.replies(limit.at_once + 2)
    assert codes(replies)[-1] == "ok"


async def test_kinds_have_limits_of_their_own(bench):
    await send_at_once(bench, OF_KIND["point"].at_once + 1)
    await send_at_once(bench, OTHERS.at_once + 1, "dance", first=2000)
    replies = codes(await bench.replies(OF_KIND["point"].at_once + OTHERS.at_once + 2))
    assert replies.count("command.not_available") == OTHERS.at_once
    assert replies.count("command.too_many") == 2


async def test_a_flood_is_dropped_counted_and_told_once_each_way(bench):
    for _ in range(ALL.at_once + 50):
        bench.receive(b"rubbish")
        await settled(bench)
    assert bench.answers == []
    assert bench.desk.refused == ALL.at_once + 50
    bench.clock.go_on_s(0.01)
    for _ in range(3):
        bench.receive(b"rubbish")
    assert [(e.code, e.active) for e in bench.events] == [("commands.flood", True)]
    bench.desk.check_flood_end()
    assert len(bench.events) == 1
    bench.clock.go_on_s(FLOOD_END_S)
    bench.desk.check_flood_end()
    bench.desk.check_flood_end()
    (_, over) = bench.events
    assert (over.code, over.active, over.data) == (
        "commands.flood",
        False,
        {"dropped": 52},  # one permission was earned meanwhile
    )
    bench.receive(command("after"))
    assert codes(await bench.replies(1)) == ["ok"]


async def test_the_broker_is_asked_to_keep_what_comes_in_thousands(bench):
    pauses = [bench.receive(b"") for _ in range(ALL.at_once + FLOOD)]
    assert set(pauses[:-1]) == {0.0}
    assert pauses[-1] == PAUSE_S
    bench.clock.go_on_s(PAUSE_S)
    assert bench.receive(b"") == 0.0


@pytest.mark.parametrize(
    "topic",
    [
        "",
        "a/+",
        "a\0b",
        "foreign/topic",
        "traverse/bench-7/cmd/scan",
        "traverse/bench-7/point",
        "traverse/other/cmd/scan",
        "traverse/other/reply/scan",
        "$share/g/x",
    ],
)
async def test_answers_do_not_go_where_a_sender_has_no_business(bench, topic):
    bench.send(command("r1"), response_topic=topic, correlation=b"c")
    (reply,) = await bench.replies(1)
    assert reply.error.code == "command.bad_response"
    (answer,) = bench.answers
    assert (answer.topic, answer.correlation) == ("traverse/bench-7/reply/point", None)
    assert bench.carried_out == []
    bench.send(command("r1"))  # the request is not used up
    assert codes(await bench.replies(2))[-1] == "ok"


async def test_answers_go_below_reply_of_the_arm(bench):
    topic = "traverse/bench-7/reply/point/client-3"
    bench.send(command("r1"), response_topic=topic)
    await bench.replies(1)
    assert bench.answers[0].topic == topic


async def test_correlation_data_are_bounded(bench):
    bench.send(command("r1"), correlation=b"x" * (MAX_CORRELATION_BYTES + 1))
    assert codes(await bench.replies(1)) == ["command.bad_response"]
    bench.send(command("r2"), correlation=b"x" * MAX_CORRELATION_BYTES)
    assert codes(await bench.replies(2))[-1] == "ok"


async def test_thousands_of_retained_commands_are_no_flood(bench):
    for _ in range(ALL.at_once + 2 * FLOOD):  # as after each subscription
        assert bench.receive(command("old"), retained=True) == 0.0
    bench.receive(command("new"))
    assert codes(await bench.replies(1)) == ["ok"]


async def test_retained_commands_are_reported(bench):
    bench.send(command("old"), retained=True)
    (event,) = bench.events
    assert event.code == "commands.retained"
    assert "traverse/bench-7/cmd/point" in event.text
    assert bench.carried_out == []


async def test_senders_cannot_write_the_log_at_will(bench, caplog):
    caplog.set_level(logging.WARNING)
    for k in range(100):
        bench.receive(command(f"r{k}", {f"a\n\x1b[31mforged {k}": 1}))
        await settled(bench)
    lines = [record.getMessage() for record in caplog.records]
    assert 1 <= len(lines) <= 25
    assert all(line.isprintable() and len(line) <= 1000 for line in lines)


async def test_refusals_without_a_line_are_counted_in_the_log(bench, caplog):
    caplog.set_level(logging.WARNING)

    async def refuse(n, first):
        for k in range(first, first + n):
            bench.receive(command(f"r{k}", {"forged": 1}))
            await settled(bench)

    def last_line():
        return caplog.records[-1].getMessage()

    await refuse(LOG_LINES.at_once + 3, 0)
    assert len(caplog.records) == LOG_LINES.at_once
    bench.clock.go_on_s(0.5)
    await refuse(1, 100)
    assert last_line().endswith("(3 more refused before it)")
    await refuse(4, 200)
    bench.desk.check_flood_end()
    assert "more commands" not in last_line()
    bench.clock.go_on_s(1.0)
    bench.desk.check_flood_end()
    assert last_line() == "3 more commands refused"
    n_logged = len(caplog.records)
    bench.desk.check_flood_end()
    assert len(caplog.records) == n_logged


async def test_a_payload_that_announces_more_than_it_holds_costs_no_memory(bench):
    nested = b"\xdd\x00\x00\x10\x00" * 1000  # lists of 4096 elements in each other
    bench.send(nested)
    await until(lambda: bench.desk.refused, "the refusal")


def test_every_kind_with_a_limit_is_a_command():
    assert set(OF_KIND) <= set(COMMANDS)
