import asyncio
import json

import msgpack
import pytest

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.dispatcher import (
    MAX_REMEMBERED,
    MAX_REMEMBERED_BYTES,
    MAX_RUNNING,
    CommandDispatcher,
)
from traverse.daemon.commands.expiry import CommandExpiry
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.protocol.encoding import decode
from traverse.protocol.messages import PointArgs, Reply
from traverse.testing.waiting import until


class SteppedClock(HostClock):
    def __init__(self) -> None:
        self.now_ns = 10**12

    def monotonic_ns(self) -> int:
        return self.now_ns

    def elapsed_ns(self) -> int:
        return self.now_ns

    def go_on_s(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


class Bench:
    """A desk with one command, `point`, that a test may hold up."""

    def __init__(self) -> None:
        self.answers = []
        self.carried_out = []
        self.go_on = asyncio.Event()
        self.go_on.set()
        self.failure = None
        self.result = {}
        self.clock = SteppedClock()
        self.events = []
        self.desk = CommandDispatcher(
            arm="bench-7",
            events=EventLog(self.clock, self.events.append),
            clock=self.clock,
            expiry=CommandExpiry("bench-7", self.clock),
            response_topics=("my/#", "elsewhere/+"),
            encoding="msgpack",
            offer=lambda answer: not self.answers.append(answer),
            carry_out={"point": self.carry_out},
        )

    async def carry_out(self, args: PointArgs):
        self.carried_out.append(args)
        await self.go_on.wait()
        if self.failure is not None:
            raise self.failure
        return {"seq": len(self.carried_out), **self.result}

    def send(self, payload: bytes, name="point", **options):
        self.clock.go_on_s(0.1)  # as a person would, unless a test overrides it
        return self.receive(payload, name, **options)

    def receive(self, payload: bytes, name="point", **options):
        options = {
            "retained": False,
            "response_topic": None,
            "correlation": None,
            "subscribed_ns": self.clock.elapsed_ns(),
            **options,
        }
        return self.desk.receive(
            IncomingCommand(f"traverse/bench-7/cmd/{name}", payload, **options)
        )

    async def replies(self, n: int) -> list[Reply]:
        await until(lambda: len(self.answers) >= n, f"{n} answers")
        return [decode(Reply, answer.payload) for answer in self.answers]


@pytest.fixture
async def bench():
    bench = Bench()
    yield bench
    await bench.desk.close()


def command(request: str, args: dict | None = None) -> bytes:
    return msgpack.packb(
        {"schema": "traverse/command/1", "request": request, "args": args or {}}
    )


async def test_the_answer_goes_to_the_reply_topic(bench):
    bench.send(command("r1"))
    (reply,) = await bench.replies(1)
    assert (reply.request, reply.ok, reply.result) == ("r1", True, {"seq": 1})
    (answer,) = bench.answers
    assert (answer.topic, answer.qos) == ("traverse/bench-7/reply/point", 1)
    assert answer.correlation is None


async def test_the_answer_goes_to_the_response_topic_with_its_correlation(bench):
    bench.send(command("r1"), response_topic="my/answers", correlation=b"\x07")
    await bench.replies(1)
    assert bench.answers[0].topic == "my/answers"
    assert bench.answers[0].correlation == b"\x07"


async def test_json_is_understood_as_well(bench):
    text = {"schema": "traverse/command/1", "request": "r1", "args": {"samples": 1}}
    bench.send(json.dumps(text).encode())
    assert (await bench.replies(1))[0].ok
    assert bench.carried_out[0].samples == 1


async def test_a_repeated_request_gets_the_first_answer_again(bench):
    bench.send(command("r1"))
    first = await bench.replies(1)
    bench.send(command("r1"), response_topic="elsewhere/x")
    assert await bench.replies(2) == first * 2
    assert bench.answers[1].topic == "elsewhere/x"
    bench.send(command("r2"))
    assert (await bench.replies(3))[2].result == {"seq": 2}
    assert len(bench.carried_out) == 2


async def test_a_repetition_while_the_first_still_runs_waits_for_it(bench):
    bench.go_on.clear()
    bench.send(command("r1"))
    await until(lambda: bench.carried_out, "the command to begin")
    bench.send(command("r1"))
    await asyncio.sleep(0)
    bench.go_on.set()
    first, second = await bench.replies(2)
    assert first == second
    assert len(bench.carried_out) == 1


async def test_a_refusal_is_answered_and_remembered_too(bench):
    bench.failure = RequestRefusedError("device.lost", "base is gone", "plug it in")
    bench.send(command("r1"))
    await bench.replies(1)
    bench.failure = None
    bench.send(command("r1"))
    for reply in await bench.replies(2):
        assert not reply.ok
        assert reply.error.code == "device.lost"
        assert reply.error.remedy == "plug it in"
    assert bench.desk.refused == 1


async def test_a_fault_of_the_daemon_is_answered_and_logged(bench, caplog):
    bench.failure = ZeroDivisionError("no way")
    bench.send(command("r1"))
    (reply,) = await bench.replies(1)
    assert (reply.ok, reply.error.code) == (False, "command.failed")
    assert "ZeroDivisionError" in reply.error.text
    assert "no way" not in reply.error.text  # what it is about stays in the house
    assert "no way" in caplog.text
    assert "fault in command point" in caplog.text


async def test_wrong_arguments_are_answered_by_their_request(bench):
    bench.send(command("r1", {"samples": 0, "dwell": 1}))
    (reply,) = await bench.replies(1)
    assert reply.error.code == "command.bad_args"
    assert "samples" in reply.error.text
    assert "dwell" in reply.error.text
    assert bench.carried_out == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("undo", "this version cannot do 'undo'"),
        ("dance", "there is no command 'dance'"),
    ],
)
async def test_unknown_commands_are_answered(bench, name, text):
    bench.send(command("r1"), name=name)
    (reply,) = await bench.replies(1)
    assert reply.error.code == "command.not_available"
    assert text in reply.error.text
    assert "it has: point" in reply.error.text
    assert bench.answers[0].topic == f"traverse/bench-7/reply/{name}"


@pytest.mark.parametrize(
    "payload", [b"", b"\xc1", b"{", b"\x81\xa1", msgpack.packb({"request": "r"})]
)
async def test_what_is_no_command_is_dropped_and_counted(bench, payload):
    bench.send(payload)
    await until(lambda: bench.desk.refused, "the refusal")
    bench.send(command("r1"))
    assert [reply.request for reply in await bench.replies(1)] == ["r1"]
    assert (bench.desk.received, bench.desk.refused) == (2, 1)


async def test_a_command_that_is_too_long_is_dropped(bench):
    bench.send(command("r1", {"note": "x" * 20_000}))
    await until(lambda: bench.desk.refused, "the refusal")
    assert bench.carried_out == []


async def test_retained_commands_are_ignored(bench):
    bench.send(command("old"), retained=True)
    bench.send(command("new"))
    assert [reply.request for reply in await bench.replies(1)] == ["new"]
    assert len(bench.carried_out) == 1


async def test_only_so_many_commands_run_at_once(bench):
    bench.go_on.clear()
    for k in range(MAX_RUNNING + 3):
        bench.send(command(f"r{k}"))
    late = await bench.replies(3)
    assert [reply.error.code for reply in late] == ["command.too_many"] * 3
    bench.go_on.set()
    replies = await bench.replies(MAX_RUNNING + 3)
    good = [reply.request for reply in replies if reply.ok]
    assert good == [f"r{k}" for k in range(MAX_RUNNING)]
    assert bench.desk.refused == 3
    bench.send(command(f"r{MAX_RUNNING}"))  # again, with its own request
    assert (await bench.replies(MAX_RUNNING + 4))[-1].ok


async def test_only_so_many_answers_are_remembered(bench):
    for k in range(MAX_REMEMBERED + 1):
        bench.send(command(f"r{k}"))
        await until(lambda: len(bench.answers) > k, "its answer")  # noqa: B023
    bench.send(command("r0"))  # forgotten
    bench.send(command("r5"))
    await bench.replies(MAX_REMEMBERED + 3)
    assert len(bench.carried_out) == MAX_REMEMBERED + 2


async def test_only_so_many_bytes_of_answers_are_remembered(bench):
    bench.result = {f"k{n}": "x" * 2000 for n in range(200)}
    n_kept = MAX_REMEMBERED_BYTES // 400_000
    for k in range(n_kept + 2):
        bench.send(command(f"r{k}"))
        await until(lambda: len(bench.answers) > k, "its answer")  # noqa: B023
    bench.send(command(f"r{n_kept + 1}"))
    await until(lambda: len(bench.answers) == n_kept + 3, "the answer again")
    assert len(bench.carried_out) == n_kept + 2
    bench.send(command("r0"))  # forgotten
    await until(lambda: len(bench.carried_out) == n_kept + 3, "the command anew")


async def test_closing_abandons_what_runs(bench):
    bench.go_on.clear()
    bench.send(command("r1"))
    await until(lambda: bench.carried_out, "the command to begin")
    await bench.desk.close()
    assert bench.answers == []
