"""Brokers that a test plays: what they refuse, announce, or answer by cutting."""

import asyncio
import contextlib

import pytest

from tests.daemon.mqtt.connection_harness import STATUS, Bench
from tests.protocol.message_examples import STATUS as STATUS_VALUE
from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.protocol.encoding import encode
from traverse.testing.waiting import until

HOST = "127.0.0.1"


class PlayedBroker:
    """Serves each connection by rules, in bytes, and notes what it was sent.

    Attributes:
        answer: to CONNECT, by its protocol level.
        connects: the protocol level of each CONNECT.
        lengths: bytes of each PUBLISH, by topic.
        refused: topics whose messages are refused, with MQTT 5.
        most_unanswered: messages of QoS 1 that waited for their answer at a time.
    """

    def __init__(self, answer, *, cut_after=None, refused=(), subscribed=1):
        self.answer = answer
        self._subscribed = subscribed
        self.refused = set(refused)
        self._cut_after = cut_after
        self.connects = []
        self.lengths = []
        self._n_unanswered = self.most_unanswered = 0

    @contextlib.asynccontextmanager
    async def running(self):
        server = await asyncio.start_server(self._serve, HOST, 0)
        async with server:
            yield BrokerAddress(HOST, server.sockets[0].getsockname()[1])

    async def _serve(self, reader, writer):
        loop = asyncio.get_running_loop()
        self._writer = writer
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            _, connect = await self._packet(reader)
            level = connect[6]
            self.connects.append(level)
            answer = self.answer(level)
            if answer:
                writer.write(answer)
                while True:
                    first, body = await self._packet(reader)
                    if first >> 4 == 3:
                        size = int.from_bytes(body[:2])
                        topic = body[2 : 2 + size].decode()
                        self.lengths.append((topic, 2 + len(body)))
                        if first & 2:
                            code = b"\x87" if topic in self.refused else b""
                            number = body[2 + size : 4 + size]
                            answer = bytes((0x40, 2 + len(code))) + number + code
                            self._n_unanswered += 1
                            self.most_unanswered = max(
                                self.most_unanswered, self._n_unanswered
                            )
                            # After all that has come together with it.
                            loop.call_soon(self._answer_message, writer, answer)
                        if self._cut_after is not None:
                            break
                    elif first >> 4 == 8:
                        codes = b"\0" if level == 5 else b""
                        writer.write(
                            bytes((0x90, 3 + len(codes)))
                            + body[:2]
                            + codes
                            + bytes((self._subscribed,))
                        )
        writer.close()

    def _answer_message(self, writer, answer):
        self._n_unanswered -= 1
        writer.write(answer)

    def cut(self):
        self._writer.transport.abort()

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
            assert [kind for kind, text in exceeded if text] == ["event"]
            bench.point("x" * 500)
            await until(lambda: exceeded[-1][0] == "point", "the point")
            assert (
                "longer than the 256 that the broker takes; points wait"
                in exceeded[-1][1]
            )
            bench.queue.offer("event", OutgoingMessage("e", bytes(50), 1))
            await until(lambda: bench.queue.sent["event"] == 2, "what is not a point")
            assert bench.queue.waiting("point") == 1  # it is kept
    assert max(length for _, length in broker.lengths) <= 256


async def test_limits_are_those_of_each_connection():
    broker = PlayedBroker(accepted(b"\x27\x00\x00\x10\x00"))  # 4096 bytes
    exceeded = []
    async with broker.running() as address:
        bench = Bench(address)
        bench.publisher.limit_exceeded = lambda _, text: text and exceeded.append(text)
        async with bench.running():
            bench.point("x" * 1000)
            await bench.all_sent()
            broker.answer = accepted(b"\x27\x00\x00\x00\xc8")  # 200 bytes
            broker.cut()
            await until(lambda: len(broker.connects) == 3, "another connection")
            bench.point("x" * 1000)
            await until(lambda: exceeded, "the point")
            assert "longer than the 200 that the broker takes" in exceeded[0]


async def test_one_point_at_a_time_where_the_broker_takes_no_more():
    broker = PlayedBroker(accepted(b"\x21\x00\x01"))  # receive maximum 1
    async with broker.running() as address, Bench(address).running() as bench:
        for n in range(300):
            bench.point(str(n))
        await bench.all_sent()
    assert len(broker.lengths) == 300
    assert broker.most_unanswered == 1


@pytest.mark.parametrize(("encoding", "limit"), [("msgpack", 256), ("json", 2048)])
async def test_what_becomes_of_a_status_that_is_too_long_is_said(encoding, limit):
    broker = PlayedBroker(accepted(b"\x27" + limit.to_bytes(4)))
    status = STATUS_VALUE.model_copy(
        update={"encoding": encoding, "probes": ("a" * 60,) * 40}
    )
    message = OutgoingMessage(STATUS, encode(status, encoding), 1, retain=True)
    outcomes = []
    async with broker.running() as address:
        bench = Bench(address)
        bench.publisher.limit_exceeded = lambda _, text: text and outcomes.append(text)
        async with bench.running():
            bench.queue.offer("status", message)
            await until(lambda: not bench.queue.waiting("status"), "the status")
    is_sent = STATUS in dict(broker.lengths)
    assert is_sent == (limit == 2048)
    said = "without its lists" if is_sent else "nobody learns the state"
    assert len(outcomes) == 1
    assert said in outcomes[0]


@pytest.mark.parametrize("kind", ["point", "status"])
async def test_refused_messages_are_said_once_and_hold_up_no_others(kind):
    topic = f"traverse/bench-7/{kind}"
    broker = PlayedBroker(accepted(), refused=[topic])
    async with broker.running() as address, Bench(address).running() as bench:
        for n in range(3):
            bench.queue.offer(kind, OutgoingMessage(topic, b"%d" % n, 1))
            bench.queue.offer("event", OutgoingMessage("e", b"", 1))
            await until(lambda n=n: bench.queue.sent["event"] > n, "others")
        refusals = [text for is_up, text in bench.changes if not is_up]
        assert [topic in text for text in refusals] == [True]
        assert bench.queue.waiting("point") == (3 if kind == "point" else 0)
        if kind == "status":
            broker.refused.clear()
            bench.queue.offer(kind, OutgoingMessage(topic, b"", 1))
            await until(lambda: bench.changes[-1][0], "the end of the refusal")


async def test_poses_that_are_refused_without_a_word_are_asked_for():
    topic = "traverse/bench-7/live"
    broker = PlayedBroker(accepted(), refused=[topic])
    async with broker.running() as address, Bench(address).running() as bench:
        for n in range(3):
            bench.queue.offer("live", OutgoingMessage(topic, b"%d" % n))
            await until(lambda: not bench.queue.waiting("live"), "an answer")
        assert [topic in text for up, text in bench.changes if not up] == [True]
        assert (bench.queue.dropped["live"], bench.queue.sent["live"]) == (1, 2)
        broker.refused.clear()
        broker.cut()
        await until(lambda: len(broker.connects) == 3, "another connection")
        for n in range(2):
            bench.queue.offer("live", OutgoingMessage(topic, b"%d" % n))
            await until(lambda n=n: bench.queue.sent["live"] == 3 + n, "it")
        assert bench.changes[-1][0]


async def test_a_refused_subscription_is_said():
    broker = PlayedBroker(accepted(), subscribed=0xA2)
    async with broker.running() as address, Bench(address).running() as bench:
        await until(lambda: len(bench.changes) == 2, "the refusal")
    assert bench.changes[0][0]
    is_up, text = bench.changes[1]
    assert not is_up
    assert "traverse/bench-7/cmd/+" in text
    assert "no wildcards" in text


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
