"""A connection that comes back by itself, with growing waits."""

import asyncio
import logging
import random
from collections.abc import Callable

import aiomqtt

from traverse.client.errors import BrokerUnreachableError
from traverse.client.mqtt.address import BrokerAddress
from traverse.client.mqtt.broker_client import AccessRefusedError
from traverse.client.mqtt.connection import IncomingMessage, ManualAckConnection

log = logging.getLogger(__name__)

FIRST_WAIT_S = 0.05
LAST_WAIT_S = 10.0


class Link:
    """Keeps a connection and its subscriptions.

    Args:
        address: of the broker.
        take: called with each message.
        came: called when a connection stands and all subscriptions with it.
        went: called when it is gone.

    Attributes:
        topics: topic filters to their quality of service.
        connections: how often a connection came about.
        reason: why there is none, for people.
    """

    def __init__(
        self,
        address: BrokerAddress,
        *,
        take: Callable[[IncomingMessage], None],
        came: Callable[[], None],
        went: Callable[[], None],
    ) -> None:
        self.address = address
        self.topics: dict[str, int] = {}
        self.connections = 0
        self.reason = "not tried yet"
        self._settled = asyncio.Event()  # there was one, or waiting is in vain
        self._take = take
        self._came = came
        self._went = went
        self._connection: ManualAckConnection | None = None

    @property
    def is_up(self) -> bool:
        """Whether there is a connection with all its subscriptions."""
        return self._connection is not None

    async def run(self) -> None:
        """Connect, wait for the end, come back; until cancelled."""
        wait_s = FIRST_WAIT_S
        while True:
            try:
                async with ManualAckConnection(self.address, self._take) as connection:
                    for topic, qos in self.topics.items():
                        await connection.subscribe_checked(topic, qos)
                    self._connection = connection
                    self.connections += 1
                    self.reason, wait_s = "", FIRST_WAIT_S
                    self._settled.set()
                    self._came()
                    await connection.ended()
            except (aiomqtt.MqttError, OSError) as error:
                self._gone(str(error))
                if isinstance(error, AccessRefusedError):
                    self._settled.set()
            finally:
                self._connection = None
            # Jitter keeps a fleet's consumers from coming back all at once.
            await asyncio.sleep(wait_s * random.uniform(0.5, 1.0))
            wait_s = min(2 * wait_s, LAST_WAIT_S)

    async def first(self, patience_s: float) -> None:
        """Wait for the first connection.

        Raises:
            BrokerUnreachableError: it took too long, or waiting for it is in vain.
        """
        late = ""
        try:
            async with asyncio.timeout(patience_s):
                await self._settled.wait()
        except TimeoutError:
            late = f" not within {patience_s:g} s"
        if not self.connections:
            raise BrokerUnreachableError(f"broker {self.address}{late}: {self.reason}")

    async def publish(self, topic: str, payload: bytes) -> None:
        """Send with quality of service 1.

        Raises:
            aiomqtt.MqttError: there is no connection, or it broke before the broker
                has taken it.
        """
        if self._connection is None:
            raise aiomqtt.MqttError(self.reason)
        await self._connection.send(topic, payload)

    def acknowledge(self, number: int) -> None:
        """Tell the broker that a message of the present connection has been taken."""
        if self._connection is not None:
            self._connection.acknowledge(number)

    async def add_topic(self, topic: str, qos: int) -> None:
        """Subscribe, now and at every connection to come."""
        self.topics[topic] = qos
        if self._connection is not None:
            await self._connection.subscribe_checked(topic, qos)

    async def drop_topic(self, topic: str) -> None:
        """Unsubscribe."""
        self.topics.pop(topic, None)
        if self._connection is not None:
            await self._connection.unsubscribe(topic)

    def _gone(self, reason: str) -> None:
        was_up, self._connection = self._connection is not None, None
        if was_up or reason != self.reason:
            log.warning("broker %s: %s", self.address, reason)
        self.reason = reason
        if was_up:
            self._went()
