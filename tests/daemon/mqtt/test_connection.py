import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from tests.daemon.mqtt.connection_harness import STATUS, Bench, Witness, address
from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.embedded_broker import embedded_broker
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


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
            assert bench.queue.offer(
                "scan", OutgoingMessage("traverse/bench-7/scan", block)
            )
        assert await witness.payloads(60) == blocks
        await bench.all_sent()
    assert bench.queue.sent["point"] == 40
    assert bench.queue.sent["scan"] == 60


async def test_a_topic_that_nobody_can_publish_on_costs_that_message_only(mosquitto):
    async with Bench(address(mosquitto)).running() as bench:
        bench.queue.offer("reply", OutgoingMessage("no/#/such", b"", qos=1))
        bench.point("0")
        await bench.all_sent()
        assert bench.queue.dropped["reply"] == 1
        assert bench.publisher.state == "connected"


async def test_the_status_is_retained(mosquitto):
    async with Bench(address(mosquitto)).running() as bench:
        bench.queue.offer(
            "status", OutgoingMessage(STATUS, b"here", qos=1, retain=True)
        )
        await until(lambda: not bench.queue.waiting("status"), "the status")
        async with Witness(mosquitto.port, STATUS) as late:
            assert await late.payloads(1) == [b"here"]
            assert late.messages[0].retain


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
        answer = OutgoingMessage(
            incoming.response_topic, b"done", 1, correlation=incoming.correlation
        )
        bench.queue.offer("reply", answer)
        assert await witness.payloads(1) == [b"done"]
    assert (incoming.topic, incoming.payload) == (topic, b"hello")
    assert not incoming.retained
    assert witness.messages[0].properties.CorrelationData == b"\x01\x02"


async def test_retained_commands_are_reported_as_such(mosquitto):
    async with Witness(mosquitto.port, "none") as witness:
        topic = "traverse/bench-7/cmd/scan"
        await witness.client.publish(topic, b"old", 1, retain=True)
        async with Bench(address(mosquitto)).running() as bench:
            await until(lambda: bench.received, "the command")
            assert bench.received[0].retained
        await witness.client.publish(topic, b"", 1, retain=True)


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
    assert bench.received[0].response_topic is None


def flooded(bench, pause_s):
    """Have each status of a bench judged as a flood, and no command; keep payloads."""
    bench.publisher.subscriptions = ("traverse/bench-7/cmd/+", STATUS)

    def receive(message):
        bench.received.append(message.payload)
        return pause_s if message.topic == STATUS else 0.0

    return receive


async def test_a_flood_on_one_topic_leaves_the_others(mosquitto):
    bench = Bench(address(mosquitto))
    receive = flooded(bench, 60.0)
    async with (
        Witness(mosquitto.port, "none") as witness,
        bench.running(receive),
    ):
        await witness.client.publish(STATUS, b"1", qos=1)
        await until(lambda: bench.received, "a status")
        bench.point("0")  # which the broker takes after it has been unsubscribed
        await bench.all_sent()
        await witness.client.publish(STATUS, b"2", qos=1)
        await witness.client.publish("traverse/bench-7/cmd/point", b"3", qos=1)
        await until(lambda: b"3" in bench.received, "the command")
    assert b"2" not in bench.received


async def test_after_a_flood_its_topic_is_subscribed_to_again(mosquitto):
    bench = Bench(address(mosquitto))
    receive = flooded(bench, 0.05)
    async with (
        Witness(mosquitto.port, "none") as witness,
        bench.running(receive),
    ):
        await witness.client.publish(STATUS, b"1", qos=1, retain=True)
        await until(lambda: bench.received.count(b"1") > 2, "it, each time")
        await witness.client.publish(STATUS, b"", qos=1, retain=True)
