import asyncio
import uuid

import pytest

from tests.mosquitto import Mosquitto
from tests.protocol import message_examples as examples
from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import ReceivedMessage, received, subscribe
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Message
from traverse.protocol.topics import event_topic, point_topic, reply_topic, status_topic

pytestmark = pytest.mark.needs("mosquitto")
PATIENCE_S = 10.0


@pytest.fixture
def arm() -> str:
    return f"arm-{uuid.uuid4().hex[:8]}"


async def round_trip(
    broker: Mosquitto, sent: list[tuple[str, bytes]], arm: str, *kinds: str
) -> list[ReceivedMessage]:
    """Publish payloads; return a subscriber's messages, up to the last one."""
    async with (
        ConfiguredClient(BrokerAddress(broker.host, broker.port)) as listening,
        ConfiguredClient(BrokerAddress(broker.host, broker.port)) as speaking,
        asyncio.timeout(PATIENCE_S),
    ):
        await subscribe(listening, arm, *((kinds,) if kinds else ()))
        for topic, payload in sent:
            await speaking.publish(topic, payload, qos=1)
        messages: list[ReceivedMessage] = []
        async for item in received(listening):
            messages.append(item)
            if item.message is not None and payload_of(item.message) == sent[-1][1]:
                break
    return messages


def payload_of(message: Message) -> bytes:
    return encode(message, "msgpack")


async def test_messages_come_decoded_in_both_encodings(
    mosquitto: Mosquitto, arm: str
) -> None:
    sent = [
        (status_topic(arm), encode(examples.STATUS, "json")),
        (point_topic(arm), encode(examples.POINT, "msgpack")),
        (reply_topic(arm, "scan"), encode(examples.REPLY, "msgpack")),
    ]
    messages = await round_trip(mosquitto, sent, arm)
    assert [(r.arm, r.kind, r.error) for r in messages] == [
        (arm, "status", None),
        (arm, "point", None),
        (arm, "reply", None),
    ]
    expected = [examples.STATUS, examples.POINT, examples.REPLY]
    assert [r.message for r in messages] == expected
    assert all(r.received_ns > 1_700_000_000_000_000_000 for r in messages)


async def test_what_cannot_be_decoded_is_reported_and_the_rest_continues(
    mosquitto: Mosquitto, arm: str
) -> None:
    sent = [
        (point_topic(arm), b"\xffrubbish"),
        (event_topic(arm), b""),
        (point_topic(arm), encode(examples.EVENT, "msgpack")),
        (point_topic(arm), encode(examples.POINT, "msgpack")),
    ]
    messages = await round_trip(mosquitto, sent, arm)
    assert [r.message for r in messages] == [None, None, None, examples.POINT]
    assert [r.kind for r in messages[:3]] == [topic for topic, _ in sent[:3]]
    assert all(r.error for r in messages[:3])
    assert "traverse/event/1" in (messages[2].error or "")


async def test_only_the_wanted_kinds_of_the_wanted_arm_come(
    mosquitto: Mosquitto, arm: str
) -> None:
    status, point = payload_of(examples.STATUS), payload_of(examples.POINT)
    sent = [
        (point_topic(f"{arm}-other"), point),
        (status_topic(arm), status),
        (point_topic(arm), point),
    ]
    messages = await round_trip(mosquitto, sent, arm, "point")
    assert [(r.arm, r.kind) for r in messages] == [(arm, "point")]
    messages = await round_trip(mosquitto, sent, "+", "point")
    assert {r.arm for r in messages} >= {f"{arm}-other"}
