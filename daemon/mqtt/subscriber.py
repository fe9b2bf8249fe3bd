"""Subscribe to commands; back off from a flood of them."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from paho.mqtt.client import MQTTMessage
from paho.mqtt.reasoncodes import ReasonCode

from traverse.daemon.clock import HostClock
from traverse.daemon.mqtt.client import BrokerClient

log = logging.getLogger("traverse.daemon.publisher")

REFUSED_SUBSCRIPTION = 128  # and above, in MQTT 3.1.1 and 5


@dataclass(frozen=True, slots=True)
class IncomingCommand:
    """A received command: topic, payload, and topic of the answer.

    Attributes:
        subscribed_ns: when this connection subscribed, by `HostClock.elapsed_ns`;
            a broker sends nothing that it had before, but what is retained.
        expiry_s: what the broker left of the sender's message expiry interval (MQTT
            5); None: the sender stated none.
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
        subscriptions: topic filters: of the commands, and what else is to be received.
        receive: called with each command; gives the time for which the broker is to
            keep further ones, mostly none [s].
    """

    def __init__(
        self,
        subscriptions: Sequence[str],
        receive: Callable[[IncomingCommand], float | None],
    ) -> None:
        self._subscriptions = [(topic, 1) for topic in subscriptions]
        self._receive = receive
        self._clock = HostClock()
        self._subscribed_ns = 0
        self._backoff_until_s = 0.0
        self._flooded = asyncio.Event()

    async def subscribe(self, client: BrokerClient) -> None:
        """Subscribe a new connection to commands, unless they are a flood."""
        self._flooded.clear()
        if self._backoff_s() <= 0.0:
            await self._subscribe(client)

    async def run(self, client: BrokerClient) -> None:
        """Receive commands until they are a flood; then the connection has to end.

        The next one does not subscribe for a time: so the broker drops those
        that wait for us, and its answers to our points are not behind them.
        """
        if (backoff_s := self._backoff_s()) > 0.0:
            await asyncio.sleep(backoff_s)
            await self._subscribe(client)
        await self._flooded.wait()

    async def _subscribe(self, client: BrokerClient) -> None:
        self._subscribed_ns = self._clock.elapsed_ns()
        codes: Sequence[int | ReasonCode] = await client.subscribe(self._subscriptions)
        for (topic, _), code in zip(self._subscriptions, codes, strict=True):
            if (code if isinstance(code, int) else code.value) >= REFUSED_SUBSCRIPTION:
                log.warning(
                    "the broker refuses the subscription to %s (%s); correct its "
                    "access list",
                    topic,
                    code,
                )

    def on_message(self, message: MQTTMessage) -> None:
        """Pass a command on; the client calls this."""
        if self._backoff_s() > 0.0:
            return  # it was on its way when the flood was noticed
        pause_s = self._receive(
            IncomingCommand(
                message.topic,
                bytes(message.payload),
                message.retain,
                getattr(message.properties, "ResponseTopic", None),
                getattr(message.properties, "CorrelationData", None),
                self._subscribed_ns,
                getattr(message.properties, "MessageExpiryInterval", None),
            )
        )
        if pause_s:
            self._backoff_until_s = asyncio.get_running_loop().time() + pause_s
            self._flooded.set()

    def _backoff_s(self) -> float:
        """How long not to subscribe yet; 0 or less: subscribe now."""
        return self._backoff_until_s - asyncio.get_running_loop().time()
