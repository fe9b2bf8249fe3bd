"""A client that follows the arm with a password, and reconnects with the broker."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

from tests.end_to_end.listener import Listener
from tests.vm.system.preparation import OPERATOR, PASSWORDS
from tests.vm.system.unit import ARM
from traverse.broker.client import MqttClient
from traverse.broker.errors import MqttError
from traverse.client.mqtt.subscription import received, subscribe
from traverse.testing.waiting import until

START_S = 60.0


@contextlib.asynccontextmanager
async def following() -> AsyncIterator[Listener]:
    """All messages of the arm while the block lasts."""
    listener = Listener(None, ARM)

    async def follow() -> None:
        while True:
            try:
                async with MqttClient(
                    "127.0.0.1", 1883, username=OPERATOR, password=PASSWORDS[OPERATOR]
                ) as client:
                    await subscribe(client, ARM)
                    listener.client = client
                    listener.connected = True
                    async for item in received(client):
                        listener.take(item.message)
            except MqttError:
                listener.connected = False
                await asyncio.sleep(0.2)  # until the broker is back

    task = asyncio.create_task(follow())
    try:
        await until(lambda: listener.connected, "the broker of the guest", START_S)
        yield listener
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
