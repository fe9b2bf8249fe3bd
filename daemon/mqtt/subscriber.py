"""Subscribe to commands; back off from a flood of them."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.broker.client import REFUSAL, MqttClient
from traverse.broker.errors import MqttError
from traverse.broker.packets import Message, Property
from traverse.broker.reasons import sentence
from traverse.daemon.clock import HostClock
from traverse.daemon.mqtt.wording import WORDING

log = logging.getLogger("traverse.daemon.publisher")

MAX_COMMAND_PAYLOAD_BYTES = 65_536  # what is longer is cut, and answered as too long


@dataclass(frozen=True, slots=True)
class IncomingCommand:
    """A received command: topic, payload, and topic of the answer.

    Attributes:
        subscribed_ns: when this run first subscribed, by `HostClock.elapsed_ns`; of
            older messages a broker sends the retained ones only.
        expiry_s: rest of the sender's message expiry interval (MQTT 5); None: the
            sender stated none.
    """

    topic: str
    payload: bytes
    retained: bool
    response_topic: str | None
    correlation: bytes | None
    subscribed_ns: int
    expiry_s: int | None = None


class CommandSubscriber:
    """Subscribe each connection to commands and pass them on.

    Args:
        subscriptions: topic filters, of commands and others.
        receive: called with each command; returns for how long the broker is to keep
            further ones, mostly none [s].
    """

    def __init__(
        self,
        subscriptions: Sequence[str],
        receive: Callable[[IncomingCommand], float | None],
    ) -> None:
        self._subscriptions = [(topic, 1) for topic in subscriptions]
        self._receive = receive
        self._client: MqttClient | None = None
        self._clock = HostClock()
        self._subscribed_ns = 0
        self._backoff_until_s = 0.0
        self._flooded = asyncio.Event()

    async def subscribe(self, client: MqttClient) -> None:
        """Subscribe a new connection to commands, unless they are a flood."""
        self._client = client
        # Not at a later one: what waited for the connection is older.
        self._subscribed_ns = self._subscribed_ns or self._clock.elapsed_ns()
        if self._backoff_s() <= 0.0:
            await self._subscribe(client)

    async def run(self, client: MqttClient) -> None:
        """Take commands until cancelled; in a flood of them let the broker keep them.

        The connection stays, for points, poses and answers.
        """
        while True:
            if (backoff_s := self._backoff_s()) > 0.0:
                await asyncio.sleep(backoff_s)
                await self._subscribe(client)
            self._flooded.clear()
            if self._backoff_s() <= 0.0:
                await self._flooded.wait()

    async def _subscribe(self, client: MqttClient) -> None:
        codes = await client.subscribe(*self._subscriptions)
        for (topic, _), code in zip(self._subscriptions, codes, strict=True):
            if code >= REFUSAL:
                log.warning(
                    "the broker refuses the subscription to %s: %s; correct its "
                    "access list",
                    topic,
                    sentence(code, WORDING),
                )

    def on_message(self, message: Message) -> None:
        response, correlation, expiry_s = (
            message.properties.get(identifier)
            for identifier in (
                Property.RESPONSE_TOPIC,
                Property.CORRELATION,
                Property.MESSAGE_EXPIRY_S,
            )
        )
        pause_s = self._receive(
            IncomingCommand(
                message.topic,
                message.payload,
                message.retain,
                response if isinstance(response, str) else None,
                correlation if isinstance(correlation, bytes) else None,
                self._subscribed_ns,
                expiry_s if isinstance(expiry_s, int) else None,
            )
        )
        if pause_s and self._backoff_s() <= 0.0 and self._client is not None:
            self._backoff_until_s = asyncio.get_running_loop().time() + pause_s
            with contextlib.suppress(MqttError):  # lost, which is noticed elsewhere
                self._client.unsubscribe([topic for topic, _ in self._subscriptions])
            self._flooded.set()

    def _backoff_s(self) -> float:
        """Time until the next subscription; 0 or less: subscribe now."""
        return self._backoff_until_s - asyncio.get_running_loop().time()
