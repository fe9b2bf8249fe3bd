import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from tests.end_to_end.listener import Listener
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import PATIENCE_S
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.hostile_messages import examples, fixed, names, payloads
from traverse.broker.decoder import HEAD_BYTES
from traverse.client.cancel_tasks import cancel_tasks
from traverse.daemon.commands.dispatcher import MAX_COMMAND_BYTES
from traverse.daemon.commands.rate_limit import ALL, FLOOD
from traverse.daemon.mqtt.connection import RECEIVE_MAXIMUM
from traverse.daemon.mqtt.subscriber import MAX_COMMAND_PAYLOAD_BYTES
from traverse.protocol import topics
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, PointArgs, ScanArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

MORE_RSS_BYTES = 40_000_000
OTHER = "arm-of-somebody-else"


def command(request: str) -> bytes:
    return encode(Command.carrying(PointArgs(), request), "msgpack")


class Attacker:
    def __init__(self, client: aiomqtt.Client, arm: str) -> None:
        self.client = client
        self._arm = arm
        self.topics: set[str] = set()

    async def send(
        self,
        payload: bytes,
        name: str = "point",
        *,
        retain: bool = False,
        response: str | None = None,
        qos: int = 1,
    ) -> None:
        properties = Properties(PacketTypes.PUBLISH)
        if response is not None:
            properties.ResponseTopic = response
            properties.CorrelationData = b"c"
        topic = f"traverse/{self._arm}/cmd/{name}"
        with contextlib.suppress(ValueError):  # the library refuses some names itself
            await self.client.publish(topic, payload, qos, retain, properties)

    async def listen(self) -> None:
        async for message in self.client.messages:
            self.topics.add(str(message.topic))


@contextlib.asynccontextmanager
async def attacking(bench: Workbench) -> AsyncIterator[Attacker]:
    async with aiomqtt.Client(
        bench.host,
        bench.port,
        protocol=aiomqtt.ProtocolVersion.V5,
        timeout=PATIENCE_S,
        max_queued_incoming_messages=100_000,
        socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
    ) as client:
        client.pending_calls_threshold = 100_000
        attacker = Attacker(client, bench.arm)
        await client.subscribe("#", qos=0)
        listening = asyncio.create_task(attacker.listen())
        try:
            yield attacker
        finally:
            await cancel_tasks([listening])


async def all_received(listener: Listener, n: int) -> None:
    await until(
        lambda: listener.healths[-1].counters["commands_received"] >= n,
        f"{n} commands received",
    )


async def rss_bytes(listener: Listener) -> int:
    await until(lambda: listener.healths, "health")
    return listener.healths[-1].rss_bytes


def n_taken(listener: Listener) -> int:
    replies = listener.replies.values()
    return sum(reply.ok and "seq" in (reply.result or {}) for reply in replies)


async def point(listener: Listener, request: str) -> None:
    answer = await listener.command(PointArgs(), request)
    assert answer.ok, answer


async def test_whatever_comes_is_answered_or_dropped_and_stays_at_home(
    resting: Workbench,
) -> None:
    rubbish = [(payload, "point") for payload in fixed()]
    rubbish += [
        (payload, name)
        for payload, name in zip(
            examples(payloads, 50), examples(names, 50), strict=True
        )
        if name.isprintable() and not set(name) & set("/+#")  # the broker's own law
    ]
    assert len(rubbish) < ALL.at_once - 60  # or not all would be looked at
    async with attacking(resting) as attacker:
        await attacker.send(command("old"), retain=True)
        async with pressing(attacker), measuring(resting) as (listener, _, _):
            await until(lambda: len(listener.replies) >= 2, "answers to early commands")
            await listener.event("commands.retained")
        async with measuring(resting) as (listener, _, daemon):
            await point(listener, "before")
            before = await rss_bytes(listener)
            for payload, name in rubbish:
                await attacker.send(payload, name)
            await misdirect(attacker, resting.arm, listener)
            for _ in range(20):  # one request, however often it is sent
                await attacker.send(command("same"))
            await point(listener, "after")
            await all_received(listener, 100)
            await until(lambda: len(listener.points) >= n_taken(listener), "all points")
            assert listener.healths[-1].rss_bytes - before < MORE_RSS_BYTES
            assert daemon.process.poll() is None
            assert listener.healths[-1].counters["reconnects"] == 0
        await attacker.send(b"", retain=True)
    assert {"before", "same", "after"} <= set(listener.replies)
    assert [p.seq for p in listener.points] == list(range(n_taken(listener)))
    assert "fault in command" not in daemon.log
    assert all(t.isprintable() and len(t) < 1200 for t in daemon.log.splitlines())
    assert not {t for t in attacker.topics if OTHER in t or t.startswith("somewhere")}


@pytest.mark.slow
async def test_commands_continue_after_any_number_of_packets_that_are_too_long(
    resting: Workbench,
) -> None:
    """More of each size than may be on their way: none may stay there."""
    async with attacking(resting) as attacker, measuring(resting) as (listener, _, _):
        before = await rss_bytes(listener)
        for n_bytes in (
            MAX_COMMAND_BYTES + 1,
            MAX_COMMAND_PAYLOAD_BYTES + 1,
            10 * HEAD_BYTES,
        ):
            for _ in range(RECEIVE_MAXIMUM + 1):
                await attacker.send(b"x" * n_bytes, "label")
            await until_answered(listener, f"after {n_bytes}")
        event = await listener.event("commands.too_long")
        assert "/cmd/label has more than 16384 bytes" in event.text
        assert listener.healths[-1].rss_bytes - before < MORE_RSS_BYTES
        assert listener.healths[-1].counters["reconnects"] == 0


async def misdirect(attacker: Attacker, arm: str, listener: Listener) -> None:
    """Name places for answers at which a sender has no business."""
    for place in (
        f"traverse/{OTHER}/cmd/point",
        f"traverse/{arm}/cmd/point",
        f"traverse/{arm}/point",
        "somewhere/else",
    ):
        await attacker.send(command(f"to {place}"), response=place)
        await until(lambda: f"to {place}" in listener.replies, place)  # noqa: B023
        error = listener.replies[f"to {place}"].error
        assert error is not None
        assert error.code == "command.bad_response"


@contextlib.asynccontextmanager
async def pressing(attacker: Attacker) -> AsyncIterator[None]:
    """Send commands all the time, starting before the daemon is there."""

    async def press() -> None:
        for k in range(10_000):
            await attacker.send(command(f"early-{k}"))
            await asyncio.sleep(0.05)  # twenty a second

    task = asyncio.create_task(press())
    try:
        yield
    finally:
        await cancel_tasks([task])


@pytest.mark.slow
async def test_a_flood_is_dropped_and_points_of_the_button_continue(
    bench: Workbench,
) -> None:
    bench.write_simulator(SPHERE.format(points=4), top="repeat = true")
    bench.write_daemon()
    stop = Command.carrying(ScanArgs(action="stop"), "flood")
    payload = encode(stop, "msgpack")
    async with attacking(bench) as attacker, measuring(bench) as (listener, _, daemon):
        await listener.n_points(2)
        before = listener.healths[-1].rss_bytes
        reconnects = listener.healths[-1].counters["reconnects"]
        # At once: one by one, a sender on a busy machine is too slow to be dropped.
        n_commands = ALL.at_once + 4 * FLOOD
        await asyncio.gather(
            *(attacker.send(payload, "scan", qos=0) for _ in range(n_commands))
        )
        raised = await listener.event("commands.flood", active=True)
        assert raised.severity == "warning"
        n_before = len(listener.points)
        await listener.n_points(n_before + 4)
        over = await listener.event("commands.flood", active=False)
        dropped = over.data["dropped"]
        assert dropped >= FLOOD
        await until_answered(listener, "after the flood")
        assert listener.healths[-1].rss_bytes - before < MORE_RSS_BYTES
        assert daemon.process.poll() is None
        assert listener.events_of("broker.lost") == []
        await until(
            lambda: listener.healths[-1].counters["commands_refused"] >= dropped
        )
        assert listener.healths[-1].counters["reconnects"] == reconnects
    once = dict.fromkeys(p.seq for p in listener.points)  # sent again where unanswered
    assert list(once) == list(range(len(once)))


async def until_answered(listener: Listener, request: str) -> None:
    """Take a point by command, as soon as commands are accepted again."""
    topic = topics.command_topic(listener._arm, "point")
    async with asyncio.timeout(PATIENCE_S):
        while request not in listener.replies:
            await listener.client.publish(topic, command(request), qos=1)
            with contextlib.suppress(AssertionError):
                await until(lambda: request in listener.replies, "it", 0.5)
    assert listener.replies[request].ok
