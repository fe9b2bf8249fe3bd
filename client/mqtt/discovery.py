"""Which arms there are on a broker."""

import asyncio
import contextlib

import aiomqtt

from traverse.client.errors import BrokerUnreachableError
from traverse.client.mqtt.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Status

QUIET_S = 0.3


async def find_arms(address: BrokerAddress, patience_s: float) -> list[str]:
    """Names of the arms that are on line, sorted; of all that were, if none is.

    Args:
        address: of the broker.
        patience_s: so long the first one is waited for.

    Raises:
        BrokerUnreachableError: there is no broker.
    """
    found: dict[str, bool] = {}
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
                        arm = topics.parse_topic(str(message.topic)).arm
                        found[arm] = _is_online(message.payload)
    except (aiomqtt.MqttError, OSError) as error:
        raise BrokerUnreachableError(f"broker {address}: {error}") from error
    online = [arm for arm, is_online in found.items() if is_online]
    return sorted(online or found)


def _is_online(payload: object) -> bool:
    """Whether a status is online; one of a later version counts as well."""
    try:
        return decode(Status, bytes(payload)).online  # type: ignore[call-overload]  # bytes
    except MessageError:
        return True
