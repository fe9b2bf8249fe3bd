"""Brokers that a test plays: what they refuse, announce, or answer by cutting."""

import asyncio
import contextlib

import pytest

from tests.daemon.mqtt.connection_harness import STATUS, Bench
from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.testing.taken import until

HOST = "127.0.0.1"


class PlayedBroker:
    """Serves each connection by rules, in bytes, and notes what it was sent.

    Attributes:
        connects: the protocol level of each CONNECT.
        lengths: bytes of each PUBLISH, by topic.
    """

    def __init__(self, answer, *, cut_after=None):
        self._answer = answer
        self._cut_after = cut_after
        self.connects = []
        self.lengths = []

    @contextlib.asynccontextmanager
    async def running(self):
        server = await asyncio.start_server(self._serve, HOST, 0)
        async with server:
            yield BrokerAddress(HOST, server.sockets[0].getsockname()[1])

    async def _serve(self, reader, writer):
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            _, connect = await self._packet(reader)
            level = connect[6]
            self.connects.append(level)
            answer = self._answer(level)
            if answer:
                writer.write(answer)
                while True:
                    first, body = await self._packet(reader)
                    if first >> 4 == 3:
                        size = int.from_bytes(body[:2])
                        topic = body[2 : 2 + size].decode()
                        self.lengths.append((topic, 2 + len(body)))
                        if first & 2:
                            writer.write(b"\x40\x02" + body[2 + size : 4 + size])
                        if self._cut_after is not None:
                            break
                    elif first >> 4 == 8:
                        codes = b"\0" if level == 5 else b""
                        writer.write(
                            bytes((0x90, 3 + len(codes))) + body[:2] + codes + b"\x01"
                        )
        writer.close()

    async def _packet(self, reader):
        first = (await reader.readexactly(1))[0]
        length, shift = 0, 0
        while True:
            byte = (await reader.readexactly(1))[0]
            length |= (byte & 0x7F) << shift
            shift += 7
            if not byte & 0x80:
                return first, await reader.readexactly(length)


def accepted(properties=b""):
    def answer(level):
        if level == 4:
            return b"\x20\x02\x00\x00"
        rest = b"\x00\x00" + bytes((len(properties),)) + properties
        return bytes((0x20, len(rest))) + rest

    return answer


@pytest.mark.parametrize("refusal", [b"", b"\x20\x02\x00\x01", b"\x20\x03\x00\x84\x00"])
async def test_mqtt_3_is_tried_where_5_is_refused_or_cut(refusal):
    broker = PlayedBroker(lambda level: accepted()(4) if level == 4 else refusal)
    async with broker.running() as address, Bench(address).running() as bench:
        bench.point("0")
        await bench.all_sent()
    assert broker.connects == [5, 4, 4]  # the probe, then by what it has learned


@pytest.mark.parametrize(
    ("properties", "words"),
    [
        (b"\x25\x00", "retain_available true"),
        (b"\x24\x00", "max_qos 1"),
    ],
)
async def test_a_broker_that_cannot_serve_is_refused_at_the_start(properties, words):
    async with PlayedBroker(accepted(properties)).running() as address:
        assert words in await Bench(address).publisher.probe()


async def test_what_is_longer_than_the_broker_takes_is_named_and_counted():
    broker = PlayedBroker(accepted(b"\x27\x00\x00\x01\x00"))  # 256 bytes
    async with broker.running() as address:
        bench = Bench(address)
        exceeded = []
        bench.publisher.limit_exceeded = lambda *what: exceeded.append(what)
        async with bench.running():
            bench.queue.offer("event", OutgoingMessage("e", bytes(500), 1))
            bench.queue.offer("event", OutgoingMessage("e", bytes(50), 1))
            await until(lambda: bench.queue.sent["event"], "the short one")
            assert bench.queue.too_long["event"] == 1
            assert [kind for kind, n_bytes, _ in exceeded if n_bytes] == ["event"]
            bench.point("x" * 500)
            await until(lambda: len(exceeded) > 2, "the point")
            assert bench.queue.waiting("point") == 1  # it is kept
    assert max(length for _, length in broker.lengths) <= 256


async def test_the_pause_grows_where_a_connection_does_not_last():
    broker = PlayedBroker(accepted(), cut_after="a message")
    async with broker.running() as address:
        bench = Bench(address)
        status = OutgoingMessage(STATUS, b"here", qos=1, retain=True)

        def change(is_up, text):
            bench.changes.append(text)
            if is_up:
                bench.queue.offer("status", status)

        bench.publisher.changed = change
        running = asyncio.create_task(bench.publisher.run(bench.received.append))
        await until(
            lambda: any("each time soon after" in text for text in bench.changes),
            "a remark on the third cut",
        )
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert len(broker.connects) == 3
