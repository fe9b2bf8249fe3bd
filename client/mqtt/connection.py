"""One connection to a broker: messages are handed over as they are read.

aiomqtt's own queue of messages loses what it has no room for, and takes a task for each
message. Here every message is passed to a function at once, and those of quality of
service 1 are acknowledged only by that function, or by a later caller: a broker stops
sending when too many wait for that.
"""

import asyncio
import logging
import random
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self, TypeVar

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import MQTTMessage

from traverse.broker.address import BrokerAddress
from traverse.broker.credentials import CredentialsError, connection_options
from traverse.broker.diagnosing_client import DiagnosingClient
from traverse.broker.reasons import Wording, is_refusal, reason_of
from traverse.client.errors import BrokerUnreachableError

log = logging.getLogger(__name__)

T = TypeVar("T")

FIRST_WAIT_S = 0.05
LAST_WAIT_S = 10.0
WORDING = Wording(
    who="this client",
    where="",
    use_tls="give mqtts:// before its name",
    absent="; start it, or correct its address",
)


class AccessRefusedError(aiomqtt.MqttError):
    """The broker refuses access, and waiting will not change that."""


class ConfiguredClient(DiagnosingClient):
    """A connection to a broker that reports why it failed.

    Args:
        address: of the broker.
        options: further ones of aiomqtt's client.

    Raises:
        AccessRefusedError: a file of the address cannot be used.
    """

    def __init__(self, address: BrokerAddress, **options: Any) -> None:
        self._address = address
        try:
            where = connection_options(address)
        except CredentialsError as error:
            raise AccessRefusedError(str(error)) from error
        super().__init__(**where, **options)

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            AccessRefusedError: the broker refuses access, or is not trusted.
            aiomqtt.MqttError: it is not there. Both state a remedy.
        """
        try:
            return await super().__aenter__()
        except aiomqtt.MqttError as error:
            refused = is_refusal(error) or is_refusal(error.__cause__)
            kind = AccessRefusedError if refused else aiomqtt.MqttError
            raise kind(reason_of(error, self._address, WORDING)) from error


@dataclass(frozen=True, slots=True)
class IncomingMessage:
    """A received message.

    Attributes:
        number: to acknowledge it by; 0 where there is nothing to acknowledge.
        acknowledge: does so, on the connection that it came by.
    """

    topic: str
    payload: bytes
    number: int
    acknowledge: Callable[[int], None]


class ManualAckConnection(ConfiguredClient):
    """A connection; use with `async with`, then wait for `wait_closed`.

    Args:
        address: of the broker.
        take: called with each message.
        options: further ones of aiomqtt's client.
    """

    def __init__(
        self,
        address: BrokerAddress,
        take: Callable[[IncomingMessage], None],
        **options: Any,
    ) -> None:
        super().__init__(address, **options)
        self._take = take
        self.pending_calls_threshold = 1000
        self._client.manual_ack_set(True)

    def acknowledge(self, number: int) -> None:
        """Acknowledge a message to the broker."""
        self._client.ack(number, 1)

    async def subscribe_checked(self, topic: str, qos: int) -> None:
        """Subscribe.

        Raises:
            aiomqtt.MqttError: the connection is lost, or the broker does not allow it.
        """
        granted = await self._while_connected(self.subscribe(topic, qos=qos))
        refused = [
            code for code in granted if not isinstance(code, int) and code.is_failure
        ]
        if refused:
            raise aiomqtt.MqttError(
                f"the broker refuses to send {topic}: {refused[0]}; correct its "
                "access list, or username and password"
            )

    async def send(self, topic: str, payload: bytes, *, retain: bool = False) -> None:
        """Publish with quality of service 1; returns on the broker's acknowledgement.

        Raises:
            aiomqtt.MqttError: the connection is lost.
        """
        await self._while_connected(self.publish(topic, payload, qos=1, retain=retain))

    async def wait_closed(self) -> None:
        """Wait until the connection is lost.

        Raises:
            aiomqtt.MqttError: always, with the reason.
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
                self._disconnected.exception()  # mark it as retrieved

    async def _while_connected(self, work: Coroutine[Any, Any, T]) -> T:
        """Await this, or stop at once when the connection is lost: aiomqtt waits on."""
        working = asyncio.ensure_future(work)
        both: set[asyncio.Future[Any]] = {working, self._disconnected}
        try:
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            if not working.done():
                await self.wait_closed()
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
        self._take(
            IncomingMessage(
                message.topic, bytes(message.payload), number, self.acknowledge
            )
        )


class ReconnectingConnection:
    """Keep a connection and its subscriptions.

    Args:
        address: of the broker.
        options: further ones of aiomqtt's client.

    Attributes:
        topics: topic filters to their quality of service.
        connections: number of connections.
        reason: why there is none, for people.
    """

    def __init__(self, address: BrokerAddress, **options: Any) -> None:
        self.address = address
        self._options = options
        self.topics: dict[str, int] = {}
        self.connections = 0
        self.reason = "not tried yet"
        self._settled = asyncio.Event()  # there was one, or waiting is in vain
        self._connection: ManualAckConnection | None = None

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection with all its subscriptions."""
        return self._connection is not None

    async def run(
        self, take: Callable[[IncomingMessage], None], changed: Callable[[bool], None]
    ) -> None:
        """Connect, wait for the end, reconnect; until cancelled.

        Args:
            take: called with each message.
            changed: called when there is a connection with all its subscriptions
                (True), and when it is lost.
        """
        wait_s = FIRST_WAIT_S
        while True:
            try:
                async with ManualAckConnection(
                    self.address, take, **self._options
                ) as connection:
                    for topic, qos in self.topics.items():
                        await connection.subscribe_checked(topic, qos)
                    self._connection = connection
                    self.connections += 1
                    self.reason, wait_s = "", FIRST_WAIT_S
                    self._settled.set()
                    changed(True)
                    await connection.wait_closed()
            except (aiomqtt.MqttError, OSError) as error:
                self._report_lost(str(error), changed)
                if isinstance(error, AccessRefusedError):
                    self._settled.set()
            finally:
                self._connection = None
            # Jitter prevents a fleet's consumers from reconnecting all at once.
            await asyncio.sleep(wait_s * random.uniform(0.5, 1.0))
            wait_s = min(2 * wait_s, LAST_WAIT_S)

    async def wait_first(self, patience_s: float) -> None:
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

    async def publish(
        self, topic: str, payload: bytes, *, retain: bool = False
    ) -> None:
        """Send with quality of service 1.

        Raises:
            aiomqtt.MqttError: there is no connection, or it broke before the broker
                has taken it.
        """
        if self._connection is None:
            raise aiomqtt.MqttError(self.reason)
        await self._connection.send(topic, payload, retain=retain)

    def acknowledge(self, number: int) -> None:
        """Acknowledge a message of the present connection to the broker."""
        if self._connection is not None:
            self._connection.acknowledge(number)

    async def add_topic(self, topic: str, qos: int) -> None:
        """Subscribe, now and at every later connection."""
        self.topics[topic] = qos
        if self._connection is not None:
            await self._connection.subscribe_checked(topic, qos)

    def _report_lost(self, reason: str, changed: Callable[[bool], None]) -> None:
        was_up, self._connection = self._connection is not None, None
        if was_up or reason != self.reason:
            log.warning("broker %s: %s", self.address, reason)
        self.reason = reason
        if was_up:
            changed(False)
