"""Any command whatever: answered or dropped, never a fault, never elsewhere."""

import asyncio
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.commands.test_dispatcher import SteppedClock
from tests.hostile_messages import deep, fixed, names, payloads
from traverse.daemon.commands.dispatcher import MAX_COMMAND_BYTES, CommandDispatcher
from traverse.daemon.commands.expiry import CommandExpiry
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.protocol.encoding import MAX_BYTES, decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import COMMANDS, Command, Reply

NOW_NS = 10**18  # after all that the clock shows: nothing is too late


class Bench:
    """A desk with every command, each of which answers with its arguments."""

    def __init__(self) -> None:
        self.answers = []
        self.clock = SteppedClock()
        self.desk = CommandDispatcher(
            arm="bench-7",
            encoding="msgpack",
            offer=lambda answer: not self.answers.append(answer),
            carry_out=dict.fromkeys(COMMANDS, self.carry_out),
            events=EventLog(self.clock, lambda what: None),
            expiry=CommandExpiry("bench-7", self.clock),
            clock=self.clock,
        )

    async def carry_out(self, args):
        return {"args": str(args)[:100]}


def send_all(messages) -> list[Reply]:
    async def run() -> Bench:
        bench = Bench()
        for message in messages:
            bench.clock.go_on_s(1.0)
            bench.desk.receive(message)
            for _ in range(10):
                await asyncio.sleep(0)
        await bench.desk.close()
        return bench

    bench = asyncio.run(run())
    assert bench.desk.received == len(messages)
    assert len(bench.answers) <= len(messages)
    for answer in bench.answers:
        assert answer.topic.startswith("traverse/bench-7/reply/")
        assert len(answer.correlation or b"") <= 256
    return [decode(Reply, answer.payload) for answer in bench.answers]


@given(
    st.lists(
        st.builds(
            IncomingCommand,
            names.map(lambda name: f"traverse/bench-7/cmd/{name}") | st.text(),
            payloads,
            st.booleans(),
            st.none() | st.text(max_size=80) | st.just("traverse/bench-7/reply/x/1"),
            st.none() | st.binary(max_size=400),
            st.just(NOW_NS),
        ),
        max_size=5,
    )
)
def test_whatever_comes_is_answered_or_dropped_without_a_fault(messages):
    for reply in send_all(messages):
        assert reply.ok or reply.error.code != "command.failed"


def test_no_payload_of_the_list_is_a_fault():
    messages = [
        IncomingCommand(
            f"traverse/bench-7/cmd/{name}", payload, False, None, None, NOW_NS
        )
        for name in ("point", "scan", "align", "resend")
        for payload in fixed()
    ]
    replies = send_all(messages)
    assert {reply.error.code for reply in replies if not reply.ok} == {
        "command.bad_args"
    }


@pytest.mark.parametrize("levels", [17, 1000, 3000])
def test_memory_of_reading_is_bounded_whatever_is_announced(levels):
    for payload in deep(levels):
        tracemalloc.start()
        with pytest.raises(MessageError):
            decode(Command, payload, max_bytes=MAX_COMMAND_BYTES, max_elements=256)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < 4_000_000


def test_a_payload_of_any_kind_is_refused_unread_when_it_is_too_long():
    with pytest.raises(MessageError, match="at most"):
        decode(Command, bytes(MAX_BYTES + 1))
