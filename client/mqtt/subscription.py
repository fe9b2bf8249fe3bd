"""Messages of arms as they arrive, and discovery of arms, for displays.

Nothing is requested again or reordered; `traverse.client.Arm` does that. Speaks MQTT
3.1.1, which every broker does; nothing in the messages needs more.
"""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass

from traverse.broker.address import BrokerAddress
from traverse.broker.client import MqttClient
from traverse.broker.errors import MqttError
from traverse.client.errors import BrokerUnreachableError
from traverse.client.mqtt.connection import ConfiguredClient, subscribe_to_any
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import MESSAGES, Clock, Command, Message, Status

KINDS = {
    message_type.__name__.lower(): message_type
    for message_type in MESSAGES
    if message_type not in (Clock, Command)
}


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """One message of an arm.

    Attributes:
        received_ns: time of arrival, UTC.
        error: of a message that could not be decoded.
    """

    arm: str
    kind: str
    received_ns: int
    message: Message | None
    error: str | None = None


async def subscribe(
    client: MqttClient, arm: str = "+", kinds: Iterable[str] = KINDS
) -> None:
    """Subscribe to messages of kinds.

    Raises:
        MqttError: the connection is lost, or the broker allows none of them.
    """
    await subscribe_to_any(
        client,
        *(
            (
                topics.kind_filter(kind).replace("/+/", f"/{arm}/", 1),
                topics.CHANNELS[kind].qos,
            )
            for kind in kinds
        ),
    )


async def received(client: MqttClient) -> AsyncIterator[ReceivedMessage]:
    """Messages as they arrive, including those that cannot be decoded."""
    async for message in client.messages:
        received_ns = time.time_ns()
        try:
            topic = topics.parse_topic(message.topic)
            decoded = decode(KINDS[topic.kind], message.payload)
        except (MessageError, KeyError) as error:
            yield ReceivedMessage("", message.topic, received_ns, None, str(error))
            continue
        yield ReceivedMessage(topic.arm, topic.kind, received_ns, decoded)


QUIET_S = 0.3


async def find_arms(address: BrokerAddress, patience_s: float) -> list[str]:
    """Return names of arms on line, sorted; all that were, if none is.

    Raises:
        BrokerUnreachableError: there is no broker.
    """
    arms = await _statuses(address, patience_s)
    online = [arm for arm, is_online in arms.items() if is_online]
    return sorted(online or arms)


async def absence_of(arm: str, address: BrokerAddress, patience_s: float) -> str:
    """State that a broker has no status of an arm, and which it has; else "".

    Args:
        arm: its name; + for any.
        address: of the broker.
        patience_s: time limit for the first status.

    Raises:
        BrokerUnreachableError: there is no broker.
    """
    arms = await _statuses(address, patience_s, arm)
    if arm in arms or (arm == "+" and arms):
        return ""
    listed = (f"{name}{'' if arms[name] else ' (off line)'}" for name in sorted(arms))
    absent = "no arm" if arm == "+" else f"no arm named {arm}"
    problem = f"{absent} has been heard at broker {address}"
    return f"{problem}; arms there: {', '.join(listed) or 'none'}"


async def _statuses(
    address: BrokerAddress, patience_s: float, arm: str = "+"
) -> dict[str, bool]:
    is_online_by_arm: dict[str, bool] = {}
    every = topics.kind_filter("status")
    # An access list may permit this one arm only, and refuse the question for all.
    filters = {every, every.replace("+", arm, 1)}
    try:
        async with ConfiguredClient(address) as client:
            await subscribe_to_any(client, *((pattern, 1) for pattern in filters))
            messages = aiter(client.messages)
            with contextlib.suppress(TimeoutError):
                wait_s = patience_s
                while True:
                    async with asyncio.timeout(wait_s):
                        message = await anext(messages)
                    wait_s = QUIET_S  # retained ones arrive all at once
                    with contextlib.suppress(MessageError):
                        arm = topics.parse_topic(message.topic).arm
                        is_online_by_arm[arm] = _is_online(message.payload)
    except (MqttError, OSError) as error:
        raise BrokerUnreachableError(f"broker {address}: {error}") from error
    return is_online_by_arm


def _is_online(payload: bytes) -> bool:
    """Return whether a status is online, even of a later version."""
    try:
        return decode(Status, payload).online
    except MessageError:
        return True
