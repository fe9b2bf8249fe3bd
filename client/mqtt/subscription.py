"""Messages of arms as they arrive, decoded: for displays of one arm or of all.

Nothing is requested again and nothing is put into order; `traverse.client.Arm` does
that. Speaks MQTT 3.1.1, which every broker does; nothing in the messages needs more.
"""

import time
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass

import aiomqtt

from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import MESSAGES, Command, Message

KINDS = {one.__name__.lower(): one for one in MESSAGES if one is not Command}
MAX_WAITING = 10_000


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """One message of an arm.

    Attributes:
        kind: a key of `KINDS`.
        received_ns: when it arrived here, UTC.
        error: what is wrong with it, where it could not be decoded.
    """

    arm: str
    kind: str
    received_ns: int
    message: Message | None
    error: str | None = None


def connection(address: BrokerAddress) -> aiomqtt.Client:
    """A connection to a broker; use with `async with`.

    Raises:
        OSError: a file of the address cannot be used.
    """
    client = ConfiguredClient(address, max_queued_incoming_messages=MAX_WAITING)
    client.pending_calls_threshold = MAX_WAITING
    return client


async def subscribe(
    client: aiomqtt.Client, arm: str = "+", kinds: Iterable[str] = KINDS
) -> None:
    """Subscribe to messages of some kinds, from one arm or from all ("+")."""
    for kind in kinds:
        pattern = topics.kind_filter(kind).replace("/+/", f"/{arm}/", 1)
        await client.subscribe(pattern, qos=topics.CHANNELS[kind].qos)


async def received(client: aiomqtt.Client) -> AsyncIterator[ReceivedMessage]:
    """Messages as they arrive, including those that cannot be decoded."""
    async for message in client.messages:
        received_ns = time.time_ns()
        payload = message.payload if isinstance(message.payload, bytes) else b""
        try:
            topic = topics.parse_topic(str(message.topic))
            decoded = decode(KINDS[topic.kind], payload)
        except (MessageError, KeyError) as error:
            yield ReceivedMessage("", str(message.topic), received_ns, None, str(error))
            continue
        yield ReceivedMessage(topic.arm, topic.kind, received_ns, decoded)
