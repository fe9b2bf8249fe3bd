"""Subscribe to commands; back off from a flood of them."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Collection, Sequence
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
        subscriptions: the topic filter of commands, and further topics.
        receive: called with each message; returns for how long the broker is to keep
            further ones of that subscription, mostly none [s].

    Attributes:
        refusal: what the broker said where it refuses subscriptions; else "".
    """

    def __init__(
        self,
        subscriptions: Sequence[str],
        receive: Callable[[IncomingCommand], float | None],
    ) -> None:
        self._subscriptions = subscriptions
        self._receive = receive
        self.refusal = ""
        self._client: MqttClient | None = None
        self._clock = HostClock()
        self._subscribed_ns = 0
        self._paused_until_s: dict[str, float] = {}
        self._flooded = asyncio.Event()

    async def subscribe(self, client: MqttClient) -> None:
        """Subscribe a new connection to all but those that are a flood."""
        self._client, self.refusal = client, ""
        # Not at a later one: what waited for the connection is older.
        self._subscribed_ns = self._subscribed_ns or self._clock.elapsed_ns()
        await self._subscribe(set(self._subscriptions) - set(self._paused_until_s))

    async def run(self) -> None:
        """Take commands until cancelled; in a flood of them let the broker keep them.

        The connection stays, for points, poses and answers.
        """
        loop = asyncio.get_running_loop()
        while True:
            if not self._paused_until_s:
                self._flooded.clear()
                await self._flooded.wait()
            topic, until_s = next(iter(self._paused_until_s.items()))
            await asyncio.sleep(until_s - loop.time())
            del self._paused_until_s[topic]
            await self._subscribe({topic})
            if self.refusal:
                log.warning("the broker %s", self.refusal)

    async def _subscribe(self, topics: Collection[str]) -> None:
        if self._client is None or not topics:
            return
        codes = await self._client.subscribe(*((topic, 1) for topic in topics))
        refused = {t: c for t, c in zip(topics, codes, strict=True) if c >= REFUSAL}
        if refused:
            why = " ".join(sentence(code, WORDING) for code in {*refused.values()})
            self.refusal = f"refuses the subscription to {', '.join(refused)}: {why}"

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
        if pause_s:
            self._pause(message.topic, pause_s)

    def _pause(self, topic: str, pause_s: float) -> None:
        if topic not in self._subscriptions:
            topic = self._subscriptions[0]
        if self._client is None or topic in self._paused_until_s:
            return  # what had been sent before
        self._paused_until_s[topic] = asyncio.get_running_loop().time() + pause_s
        with contextlib.suppress(MqttError):  # lost, which is noticed elsewhere
            self._client.unsubscribe([topic])
        self._flooded.set()
