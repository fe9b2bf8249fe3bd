"""Which arms there are on a broker."""

import asyncio
import contextlib

import aiomqtt

from traverse.broker.address import BrokerAddress
from traverse.client.errors import BrokerUnreachableError
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
    found = await _statuses(address, patience_s)
    online = [arm for arm, is_online in found.items() if is_online]
    return sorted(online or found)


async def absence_of(arm: str, address: BrokerAddress, patience_s: float) -> str:
    """Say that a broker has no status of an arm, and of which it has; else "".

    Args:
        arm: its name; + for any.
        address: of the broker.
        patience_s: so long the first status is waited for.

    Raises:
        BrokerUnreachableError: there is no broker.
    """
    found = await _statuses(address, patience_s, arm)
    if arm in found or (arm == "+" and found):
        return ""
    there = (f"{name}{'' if found[name] else ' (off line)'}" for name in sorted(found))
    who = "no arm" if arm == "+" else f"no arm named {arm}"
    told = f"{who} has been heard at broker {address}"
    return f"{told}; arms there: {', '.join(there) or 'none'}"


async def _statuses(
    address: BrokerAddress, patience_s: float, arm: str = "+"
) -> dict[str, bool]:
    """Which arms a broker has a status of, and whether they are on line."""
    found: dict[str, bool] = {}
    every = topics.kind_filter("status")
    # An access list may permit this one arm only, and refuse the question for all.
    filters = {every, every.replace("+", arm, 1)}
    try:
        async with ConfiguredClient(address) as client:
            await client.subscribe([(one, 1) for one in filters])
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
    return found


def _is_online(payload: object) -> bool:
    """Whether a status is online; one of a later version counts as well."""
    try:
        return decode(Status, bytes(payload)).online  # type: ignore[call-overload]  # bytes
    except MessageError:
        return True
