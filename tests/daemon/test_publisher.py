import asyncio
import contextlib
import socket
import sys

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from daemon.broker_access import BrokerAddress
from daemon.embedded_broker import BrokerStartError, embedded_broker
from daemon.outgoing import Outgoing, OutgoingQueue
from daemon.publisher import Publisher
from tests.drivers.taken import until

pytestmark = pytest.mark.broker

STATUS = "traverse/bench-7/status"


class Bench:
    """A publisher and what it told."""

    def __init__(self, address: BrokerAddress) -> None:
        self.queue = OutgoingQueue()
        self.received = []
        self.changes = []
        self.publisher = Publisher(
            address=address,
            client_id="traverse-bench-7",
            will=Outgoing(STATUS, b"gone", qos=1, retain=True),
            encoding="msgpack",
            queue=self.queue,
            subscription="traverse/bench-7/cmd/+",
            receive=self.received.append,
            changed=lambda *change: self.changes.append(change),
        )

    @contextlib.asynccontextmanager
    async def running(self):
        assert await self.publisher.probe() is None  # as the service does
        task = asyncio.create_task(self.publisher.run())
        try:
            await until(lambda: self.publisher.state == "connected", "a connection")
            yield self
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    def point(self, name: str) -> None:
        self.queue.offer("point", Outgoing("traverse/bench-7/point", name.encode(), 1))

    async def all_sent(self) -> None:
        await until(lambda: not self.queue.waiting("point"), "all points to be sent")


class Witness:
    """A subscriber of its own, in MQTT 5 unless told otherwise."""

    def __init__(self, port: int, topic: str, **options) -> None:
        self.messages = []
        self._topic = topic
        self.client = aiomqtt.Client(
            "127.0.0.1",
            port,
            **{"protocol": aiomqtt.ProtocolVersion.V5, "timeout": 5, **options},
        )

    async def __aenter__(self):
        await self.client.__aenter__()
        await self.client.subscribe(self._topic, qos=1)
        self._task = asyncio.create_task(self._collect())
        return self

    async def _collect(self) -> None:
        async for message in self.client.messages:
            self.messages.append(message)

    async def __aexit__(self, *error):
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        with contextlib.suppress(aiomqtt.MqttError):
            await self.client.__aexit__(*error)

    async def payloads(self, n: int) -> list[bytes]:
        await until(lambda: len(self.messages) >= n, f"{n} messages")
        return [message.payload for message in self.messages]


def address(broker, **options) -> BrokerAddress:
    return BrokerAddress(broker.host, broker.port, **options)


async def test_points_arrive_in_order_with_their_content_type(mosquitto):
    async with (
        Witness(mosquitto.port, "traverse/bench-7/point") as witness,
        Bench(address(mosquitto)).running() as bench,
    ):
        for k in range(50):
            bench.point(str(k))
        payloads = await witness.payloads(50)
        await bench.all_sent()
    assert payloads == [str(k).encode() for k in range(50)]
    assert witness.messages[0].properties.ContentType == "application/msgpack"
    assert witness.messages[0].qos == 1
    assert bench.publisher.protocol == "5"
    assert bench.queue.sent["point"] == 50
    assert bench.changes[0][0] is True


async def test_many_blocks_behind_many_points_are_sent_as_answers_come(mosquitto):
    async with (
        Witness(mosquitto.port, "traverse/bench-7/scan") as witness,
        Bench(address(mosquitto)).running() as bench,
    ):
        for k in range(40):  # more than may be on their way at a time
            bench.point(str(k))
        blocks = [bytes([k]) * 50_000 for k in range(60)]  # more than a socket takes
        for block in blocks:
            assert bench.queue.offer("scan", Outgoing("traverse/bench-7/scan", block))
        assert await witness.payloads(60) == blocks
        await bench.all_sent()
    assert bench.queue.sent["point"] == 40
    assert bench.queue.sent["scan"] == 60


async def test_a_topic_that_nobody_can_publish_on_costs_that_message_only(mosquitto):
    async with Bench(address(mosquitto)).running() as bench:
        bench.queue.offer("reply", Outgoing("no/#/such", b"", qos=1))
        bench.point("0")
        await bench.all_sent()
        assert bench.queue.dropped["reply"] == 1
        assert bench.publisher.state == "connected"


async def test_the_status_is_retained(mosquitto):
    async with Bench(address(mosquitto)).running() as bench:
        bench.queue.offer("status", Outgoing(STATUS, b"here", qos=1, retain=True))
        await until(lambda: not bench.queue.waiting("status"), "the status")
        async with Witness(mosquitto.port, STATUS) as late:
            assert await late.payloads(1) == [b"here"]
            assert late.messages[0].retain


async def test_the_will_is_published_when_the_process_vanishes(mosquitto):
    async with Witness(mosquitto.port, STATUS) as witness:
        program = (
            "import asyncio, sys; from tests.daemon.test_publisher import *\n"
            "async def main():\n"
            "    async with Bench(BrokerAddress('127.0.0.1', int(sys.argv[1])))"
            ".running():\n"
            "        print('connected', flush=True)\n"
            "        await asyncio.sleep(60)\n"
            "asyncio.run(main())\n"
        )
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", program, str(mosquitto.port)),
            stdout=asyncio.subprocess.PIPE,
        )
        try:
            assert await process.stdout.readline() == b"connected\n"
        finally:
            process.kill()
            await process.communicate()
        await until(lambda: b"gone" in [m.payload for m in witness.messages], "will")


async def test_an_orderly_end_publishes_no_will(mosquitto):
    async with Witness(mosquitto.port, f"{STATUS}/#") as witness:
        before = len(witness.messages)
        async with Bench(address(mosquitto)).running() as bench:
            bench.queue.offer("status", Outgoing(STATUS, b"bye", qos=1, retain=True))
            await until(lambda: not bench.queue.waiting("status"), "the status")
        await until(
            lambda: b"bye" in [m.payload for m in witness.messages], "the last word"
        )
        async with Bench(address(mosquitto)).running():
            pass  # by now the broker has dealt with the first one's end
    assert b"gone" not in [m.payload for m in witness.messages[before + 1 :]]


async def test_points_of_an_outage_are_delivered_once_each_in_order(make_mosquitto):
    broker = make_mosquitto()
    async with Bench(address(broker)).running() as bench:
        bench.point("0")
        await bench.all_sent()
        broker.kill()
        await until(lambda: bench.publisher.state == "lost", "the loss")
        for k in range(1, 30):
            bench.point(str(k))
        assert bench.queue.waiting("point") == 29
        broker.start()
        async with Witness(broker.port, "traverse/bench-7/point") as witness:
            await bench.all_sent()
            arrived = [int(message.payload) for message in witness.messages]
        assert bench.publisher.reconnects == 1
    # The witness came in while they were being sent; what it saw was in order.
    assert arrived == list(range(min(arrived, default=0), 30))[: len(arrived)]
    assert bench.queue.sent["point"] == 30
    assert [up for up, _ in bench.changes] == [True, False, True]


async def test_a_session_of_the_witness_sees_every_point_of_an_outage_once(
    make_mosquitto,
):
    broker = make_mosquitto()
    async with Bench(address(broker)).running() as bench:
        broker.stop()
        await until(lambda: bench.publisher.state == "lost", "the loss")
        seen = []
        task = asyncio.create_task(first_come(broker.port, seen))
        for k in range(20):
            bench.point(str(k))
        # The publisher waits 0.1 s at least between tries, the witness 1 ms.
        broker.start()
        await bench.all_sent()
        await until(lambda: len(seen) >= 20 or task.done(), "20 points")
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert seen[-1] == b"19"
    assert seen == sorted(set(seen), key=int)


async def first_come(port: int, seen: list[bytes]) -> None:
    while True:
        try:
            async with aiomqtt.Client("127.0.0.1", port) as client:
                await client.subscribe("traverse/bench-7/point", qos=1)
                async for message in client.messages:
                    seen.append(message.payload)  # noqa: PERF401 - it never ends
        except aiomqtt.MqttError:
            await asyncio.sleep(0.001)


async def test_commands_come_in_with_the_way_back(mosquitto):
    async with (
        Bench(address(mosquitto)).running() as bench,
        Witness(mosquitto.port, "my/answers") as witness,
    ):
        properties = Properties(PacketTypes.PUBLISH)
        properties.ResponseTopic = "my/answers"
        properties.CorrelationData = b"\x01\x02"
        topic = "traverse/bench-7/cmd/point"
        await witness.client.publish(topic, b"hello", 1, properties=properties)
        await until(lambda: bench.received, "the command")
        (incoming,) = bench.received
        answer = Outgoing(
            incoming.response_topic, b"done", 1, correlation=incoming.correlation
        )
        bench.queue.offer("reply", answer)
        assert await witness.payloads(1) == [b"done"]
    assert (incoming.topic, incoming.payload) == (topic, b"hello")
    assert not incoming.retained
    assert witness.messages[0].properties.CorrelationData == b"\x01\x02"


async def test_retained_commands_are_told_as_such(mosquitto):
    async with Witness(mosquitto.port, "none") as witness:
        topic = "traverse/bench-7/cmd/scan"
        await witness.client.publish(topic, b"old", 1, retain=True)
        async with Bench(address(mosquitto)).running() as bench:
            await until(lambda: bench.received, "the command")
            assert bench.received[0].retained
        await witness.client.publish(topic, b"", 1, retain=True)


async def test_a_point_that_the_broker_refuses_is_kept_and_told(make_mosquitto):
    broker = make_mosquitto()
    broker.stop()
    broker.allow_writing(STATUS)
    broker.start()
    async with Bench(address(broker)).running() as bench:
        put_off = []
        block = Outgoing("not/mine", b"", 1, refused=lambda: put_off.append("block"))
        bench.queue.offer("spooled", block)
        bench.queue.offer("reply", Outgoing("not/mine", b"", qos=1))
        bench.point("0")
        await until(lambda: len(bench.changes) == 2, "the refusal")
        up, text = bench.changes[1]
        assert not up
        assert "refuses traverse/bench-7/point" in text
        assert bench.queue.waiting("point") == 1
        assert bench.queue.sent["point"] == 0
        assert bench.queue.dropped["reply"] == 1
        await until(lambda: put_off, "the block's refusal")
        assert (bench.queue.waiting("spooled"), bench.queue.dropped["spooled"]) == (
            0,
            0,
        )
        broker.stop()
        broker.allow_writing("#")
        broker.start()
        await bench.all_sent()
        await until(lambda: bench.queue.sent["point"], "the point")


async def test_a_broker_that_is_not_there_is_told(make_mosquitto):
    broker = make_mosquitto()
    broker.stop()
    assert await Bench(address(broker)).publisher.probe() == "nothing listens there"


async def test_a_host_that_does_not_exist_is_told():
    bench = Bench(BrokerAddress("no-such-host.invalid", 1883))
    assert await bench.publisher.probe() == "no such host"


async def test_a_wrong_password_is_told(make_mosquitto, tmp_path):
    broker = make_mosquitto({"arm": "secret"})
    password = tmp_path / "password"
    password.write_text("guess\n")
    given = address(broker, username="arm", password_file=str(password))
    assert "refuses user 'arm'" in await Bench(given).publisher.probe()
    password.write_text("secret\n")
    assert await Bench(given).publisher.probe() is None


async def test_a_missing_password_file_is_told(mosquitto, tmp_path):
    missing = tmp_path / "nowhere"
    given = address(mosquitto, username="arm", password_file=str(missing))
    assert str(missing) in await Bench(given).publisher.probe()


async def test_something_that_is_no_broker_is_told():
    async def greet(reader, writer):
        writer.write(b"SSH-2.0-nothing\r\n")
        writer.close()

    server = await asyncio.start_server(greet, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with server:
        assert await Bench(BrokerAddress("127.0.0.1", port)).publisher.probe()


async def test_a_broker_of_mqtt_3_is_spoken_to_in_its_own_tongue():
    async with embedded_broker(0) as port:
        given = BrokerAddress("127.0.0.1", port)
        async with (
            Witness(
                port, "traverse/bench-7/#", protocol=aiomqtt.ProtocolVersion.V311
            ) as witness,
            Bench(given).running() as bench,
        ):
            for k in range(5):
                bench.point(str(k))
            assert await witness.payloads(5) == [str(k).encode() for k in range(5)]
            await witness.client.publish("traverse/bench-7/cmd/point", b"now", 1)
            await until(lambda: bench.received, "the command")
    assert bench.publisher.protocol == "3.1.1"
    assert bench.received[0].response_topic is None


async def test_an_embedded_broker_without_a_free_port_says_so():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(BrokerStartError, match=str(port)):
            async with embedded_broker(port):
                pass
