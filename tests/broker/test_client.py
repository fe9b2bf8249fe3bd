import asyncio
import contextlib
from itertools import pairwise

import pytest
import uvloop

from traverse.broker.client import Handlers, MqttClient
from traverse.broker.errors import (
    ClosedBeforeAnswerError,
    ConnectionCutError,
    ConnectRefusedError,
    DisconnectedError,
    MqttError,
    RefusedError,
)
from traverse.broker.inbox import MAX_QUEUED
from traverse.broker.packets import Message, Version, publish_packet
from traverse.testing.waiting import until

HOST = "127.0.0.1"
ACCEPTED = b"\x20\x03\x00\x00\x00"  # MQTT 5: CONNACK, success, no properties
POINT = publish_packet("p", b"abc", qos=1, number=1, properties=b"\0")


class PlayedBroker:
    """What a test says and reads as a broker, once a client has connected."""

    def __init__(self, answer):
        self._answer = answer
        self.port = 0
        self.connect = b""
        self.is_there = asyncio.Event()

    async def meet(self, reader, writer):
        self.reader, self.writer = reader, writer
        head = await reader.readexactly(2)
        self.connect = head + await reader.readexactly(head[1])
        writer.write(self._answer)
        if not self._answer:
            writer.close()
        self.is_there.set()

    async def reads(self, data):
        assert await self.reader.readexactly(len(data)) == data


@contextlib.asynccontextmanager
async def played(answer=ACCEPTED):
    broker = PlayedBroker(answer)
    server = await asyncio.start_server(broker.meet, HOST, 0)
    async with server:
        broker.port = server.sockets[0].getsockname()[1]
        yield broker
        if broker.is_there.is_set():
            broker.writer.close()
            with contextlib.suppress(ConnectionError):
                await broker.writer.wait_closed()


@contextlib.asynccontextmanager
async def connected(answer=ACCEPTED, **options):
    async with played(answer) as broker:
        options = {"version": Version.V5, **options}
        async with MqttClient(HOST, broker.port, **options) as client:
            await broker.is_there.wait()
            yield client, broker


async def test_a_point_is_published_and_acknowledged():
    async with connected() as (client, broker):
        publishing = asyncio.create_task(client.publish("p", b"abc", 1))
        await broker.reads(POINT)
        assert not publishing.done()
        broker.writer.write(b"\x40\x02\x00\x01")
        await publishing
    await broker.reads(b"\xe0\x00")  # DISCONNECT: no will is published


async def test_a_refused_point_raises_the_reason_code():
    async with connected() as (client, broker):
        publishing = asyncio.create_task(client.publish("p", b"abc", 1))
        await broker.reads(POINT)
        broker.writer.write(b"\x40\x04\x00\x01\x97\x00")
        with pytest.raises(RefusedError) as caught:
            await publishing
        assert caught.value.code == 0x97


async def test_numbers_that_wait_for_an_answer_are_not_given_again():
    async with connected() as (client, _):
        waiting = asyncio.create_task(client.publish("p", b"abc", 1))
        await asyncio.sleep(0)
        given = {client.next_number() for _ in range(70_000)}
        assert given == set(range(2, 65_536))
        waiting.cancel()


async def test_no_more_messages_are_on_their_way_than_the_broker_takes():
    two = b"\x20\x06\x00\x00\x03\x21\x00\x02"  # receive maximum 2
    async with connected(two) as (client, broker):
        assert client.limits.receive_maximum == 2
        publishing = [
            asyncio.create_task(client.publish("p", bytes((k,)), 1)) for k in range(3)
        ]
        for k in (0, 1):
            await broker.reads(
                publish_packet("p", bytes((k,)), qos=1, number=k + 1, properties=b"\0")
            )
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await broker.reader.read(1)
        broker.writer.write(b"\x40\x02\x00\x01\x40\x02\x00\x02")
        await broker.reads(
            publish_packet("p", b"\x02", qos=1, number=3, properties=b"\0")
        )
        broker.writer.write(b"\x40\x02\x00\x03")
        await asyncio.gather(*publishing)


async def test_subscriptions_return_the_codes_of_the_broker():
    async with connected() as (client, broker):
        subscribing = asyncio.create_task(client.subscribe(("a", 1), ("b", 1)))
        await broker.reads(b"\x82\x0b\x00\x01\x00\x00\x01a\x01\x00\x01b\x01")
        broker.writer.write(b"\x90\x05\x00\x01\x00\x01\x87")
        assert await subscribing == (1, 0x87)


@pytest.mark.parametrize(
    "answer",
    [
        b"\x90\x04\x00\x01\x00\x01",
        b"\x90\x03\x00\x01\x00",
        b"\x90\x06\x00\x01\x00\x01\x01\x01",
        b"\x40\x02\x00\x01",
    ],
)
async def test_an_answer_that_fits_no_question_is_an_error(answer):
    async with connected() as (client, broker):
        subscribing = asyncio.create_task(client.subscribe(("a", 1), ("b", 1)))
        await broker.reads(b"\x82\x0b\x00\x01\x00\x00\x01a\x01\x00\x01b\x01")
        broker.writer.write(answer)
        with pytest.raises(MqttError, match="no MQTT"):
            await subscribing


async def test_received_messages_are_acknowledged_after_they_were_handled():
    received = []
    handlers = Handlers(received=received.append)
    async with connected(handlers=handlers) as (_, broker):
        broker.writer.write(POINT + publish_packet("q", b"", properties=b"\0"))
        await broker.reads(b"\x40\x02\x00\x01")
        await until(lambda: len(received) == 2)
    assert received == [
        Message("p", b"abc", 1, number=1, n_bytes=3),
        Message("q", b""),
    ]


async def test_messages_that_nobody_takes_are_dropped_and_counted_beyond_a_bound():
    message = publish_packet("q", b"", properties=b"\0")
    async with connected() as (client, broker):
        broker.writer.write(message * (MAX_QUEUED + 5))
        await until(lambda: client.inbox.n_dropped == 5)
        async for received in client.messages:
            assert received.topic == "q"
            break


async def test_a_flood_leaves_the_event_loop_to_others():
    """A timer of 1 ms runs between the packets of a flood, again and again."""
    received, seen = [], []
    message = publish_packet("q", bytes(100), properties=b"\0")

    def take(packet):
        sum(range(2000))  # as a command that is refused
        received.append(packet)

    async with connected(handlers=Handlers(received=take)) as (_, broker):
        broker.writer.write(message * 5_000)
        while len(received) < 5_000:
            seen.append(len(received))
            await asyncio.sleep(0.001)
    assert max(after - before for before, after in pairwise(seen)) < 4_000


async def test_what_the_socket_does_not_take_follows_whole_and_in_order():
    writable = []
    handlers = Handlers(writable=lambda: writable.append(True))
    async with connected(handlers=handlers) as (client, broker):
        packets = [
            publish_packet("live", bytes((k,)) * 500_000, properties=b"\0")
            for k in range(30)
        ]
        for packet in packets:
            client.write(packet)
        assert client.is_congested
        await broker.reads(b"".join(packets))
        await until(lambda: bool(writable))
        assert not client.is_congested


async def test_a_silent_broker_is_noticed():
    second = b"\x20\x06\x00\x00\x03\x13\x00\x01"  # server keep alive 1 s
    async with connected(second, keep_alive_s=60) as (client, broker):
        await broker.reads(b"\xc0\x00")  # PINGREQ
        with pytest.raises(MqttError, match="nothing was received for 1 s"):
            await client.wait_closed()


async def test_a_living_broker_is_kept():
    second = b"\x20\x06\x00\x00\x03\x13\x00\x01"
    async with connected(second) as (client, broker):
        for _ in range(2):
            await broker.reads(b"\xc0\x00")
            broker.writer.write(b"\xd0\x00")
        client.write(POINT)


async def test_the_reason_of_the_end_is_the_brokers():
    async with connected() as (client, broker):
        waiting = asyncio.create_task(client.publish("p", b"abc", 1))
        await broker.reads(POINT)
        broker.writer.write(b"\xe0\x07\x8b\x05\x1f\x00\x02no")
        for work in (client.wait_closed(), waiting):
            with pytest.raises(DisconnectedError) as caught:
                await work
            assert (caught.value.code, caught.value.text) == (0x8B, "no")
        with pytest.raises(DisconnectedError):
            client.write(POINT)


async def test_a_cut_connection_fails_what_waits():
    async with connected() as (client, broker):
        waiting = asyncio.create_task(client.publish("p", b"abc", 1))
        await broker.reads(POINT)
        broker.writer.transport.abort()
        with pytest.raises(ConnectionCutError):
            await waiting


async def test_bytes_that_are_no_mqtt_end_the_connection():
    async with connected() as (client, broker):
        broker.writer.write(b"\x00\x00")
        with pytest.raises(MqttError, match="no MQTT"):
            await client.wait_closed()


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (b"", ClosedBeforeAnswerError),
        (b"\x20\x03\x00\x87\x00", ConnectRefusedError),
        (b"\x20\x02\x00\x01", ConnectRefusedError),
        (b"\x30\x03\x00\x05p", MqttError),
        (b"\x20\x06\x00\x00\x03\x21\x00\x00", MqttError),  # takes no message
        (b"\x20\x08\x00\x00\x05\x27\x00\x00\x00\x00", MqttError),  # of any length
    ],
)
async def test_a_refused_connection_is_an_error_of_its_kind(answer, kind):
    async with played(answer) as broker:
        client = MqttClient(HOST, broker.port, version=Version.V5)
        with pytest.raises(kind):
            await client.__aenter__()


async def test_a_client_that_does_not_wait_for_the_answer_leaves():
    met, left = asyncio.Event(), asyncio.Event()

    async def be_silent(reader, writer):
        await reader.readexactly(1)
        met.set()
        with contextlib.suppress(ConnectionError):
            await reader.read()  # up to the end
        left.set()
        writer.close()

    server = await asyncio.start_server(be_silent, HOST, 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        connecting = asyncio.create_task(MqttClient(HOST, port).__aenter__())
        await met.wait()
        connecting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await connecting
        async with asyncio.timeout(10):
            await left.wait()


async def test_nothing_can_be_sent_before_there_is_a_connection():
    with pytest.raises(MqttError):
        MqttClient("nowhere", 1883).write(POINT)


def test_it_works_on_uvloop_too_which_the_page_runs_on():
    async def exchange():
        async with connected() as (client, broker):
            publishing = asyncio.create_task(client.publish("p", b"abc", 1))
            await broker.reads(POINT)
            broker.writer.write(b"\x40\x02\x00\x01" + POINT)
            await publishing
            async for message in client.messages:
                return message.payload
        raise AssertionError("no message")

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        assert runner.run(exchange()) == b"abc"
