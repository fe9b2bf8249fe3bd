"""Which arms there are on a broker."""

import asyncio
import contextlib

import aiomqtt

from traverse.client.errors import BrokerUnreachableError
from traverse.client.mqtt.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.protocol import topics
from traverse.protocol.message_error import MessageError

QUIET_S = 0.3


async def find_arms(address: BrokerAddress, patience_s: float) -> list[str]:
    """Names of all arms with a status at the broker, sorted.

    Args:
        address: of the broker.
        patience_s: so long the first one is waited for.

    Raises:
        BrokerUnreachableError: there is no broker.
    """
    found: set[str] = set()
    try:
        async with ConfiguredClient(address) as client:
            await client.subscribe(topics.kind_filter("status"), qos=1)
            messages = aiter(client.messages)
            with contextlib.suppress(TimeoutError):
                wait_s = patience_s
                while True:
                    async with asyncio.timeout(wait_s):
                        message = await anext(messages)
                    wait_s = QUIET_S  # retained ones arrive all at once
                    with contextlib.suppress(MessageError):
                        found.add(topics.parse_topic(str(message.topic)).arm)
    except (aiomqtt.MqttError, OSError) as error:
        raise BrokerUnreachableError(f"broker {address}: {error}") from error
    return sorted(found)
