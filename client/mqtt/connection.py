"""One connection to a broker: messages are handed over as they are read.

aiomqtt's own queue of messages loses what it has no room for, and takes a task for each
message. Here every message goes to a function at once, and those of quality of service
1 are acknowledged only when that function, or somebody later, says so: a broker stops
sending when too many wait for that.
"""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from types import TracebackType
from typing import Any, TypeVar

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import MQTTMessage

from traverse.client.mqtt.address import BrokerAddress
from traverse.client.mqtt.broker_client import ConfiguredClient

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class IncomingMessage:
    """A message as it came.

    Attributes:
        number: to acknowledge it by; 0 where there is nothing to acknowledge.
    """

    topic: str
    payload: bytes
    number: int


class ManualAckConnection(ConfiguredClient):
    """A connection; use with `async with`, then wait for `ended`.

    Args:
        address: of the broker.
        take: called with each message.
    """

    def __init__(
        self, address: BrokerAddress, take: Callable[[IncomingMessage], None]
    ) -> None:
        super().__init__(address)
        self._take = take
        self.pending_calls_threshold = 1000
        self._client.manual_ack_set(True)

    def acknowledge(self, number: int) -> None:
        """Tell the broker that a message has been taken."""
        self._client.ack(number, 1)

    async def subscribe_checked(self, topic: str, qos: int) -> None:
        """Subscribe.

        Raises:
            aiomqtt.MqttError: the connection is gone, or the broker does not allow it.
        """
        granted = await self._while_connected(self.subscribe(topic, qos=qos))
        refused = [
            code for code in granted if not isinstance(code, int) and code.is_failure
        ]
        if refused:
            raise aiomqtt.MqttError(
                f"the broker does not let us read {topic}: {refused[0]}; correct its "
                "access list, or username and password"
            )

    async def send(self, topic: str, payload: bytes) -> None:
        """Publish with quality of service 1; returns when the broker has it.

        Raises:
            aiomqtt.MqttError: the connection is gone.
        """
        await self._while_connected(self.publish(topic, payload, qos=1))

    async def ended(self) -> None:
        """Wait until the connection is gone.

        Raises:
            aiomqtt.MqttError: always; why it went.
        """
        await asyncio.wait({self._disconnected})
        error = self._disconnected.exception()
        if error is not None and not isinstance(error, OSError | aiomqtt.MqttError):
            raise error  # a fault of ours
        if isinstance(error, aiomqtt.MqttCodeError):
            raise aiomqtt.MqttError("the connection was lost") from error
        raise aiomqtt.MqttError(str(error or "the broker has ended the connection"))

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            await super().__aexit__(kind, error, trace)
        finally:
            if self._disconnected.done() and not self._disconnected.cancelled():
                self._disconnected.exception()  # it has been heard

    async def _while_connected(self, work: Coroutine[Any, Any, T]) -> T:
        """Do this, or stop at once when the connection goes: aiomqtt waits on."""
        working = asyncio.ensure_future(work)
        both: set[asyncio.Future[Any]] = {working, self._disconnected}
        try:
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            if not working.done():
                await self.ended()
            return working.result()
        finally:
            working.cancel()

    def _on_message(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt declares it
        message: MQTTMessage,
    ) -> None:
        number = message.mid if message.qos else 0
        self._take(IncomingMessage(message.topic, bytes(message.payload), number))
