"""One connection to a broker: messages are handed over as they are read.

Every message is passed to a function at once; messages of quality of service 1 are
acknowledged by that function, or by a later caller: a broker stops sending when too
many wait for that.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

from traverse.broker.address import BrokerAddress
from traverse.broker.certificates import CertificateWatch
from traverse.broker.client import REFUSAL, Handlers, MqttClient
from traverse.broker.credentials import CredentialsError, connection_options
from traverse.broker.errors import MqttError
from traverse.broker.packets import Message
from traverse.broker.pause import LASTING_S, GrowingPause
from traverse.broker.reasons import Wording, is_refusal, reason_of, sentence
from traverse.client.errors import BrokerUnreachableError

log = logging.getLogger(__name__)
# Not below `traverse.client`, which commands silence: nothing else says this.
CERTIFICATES_LOG = "traverse.certificates"

FIRST_WAIT_S = 0.05
LAST_WAIT_S = 10.0
LOOK_S = 3600.0  # at the ends of certificates
WORDING = Wording(
    who="this client",
    where="",
    use_tls="give mqtts:// before its name",
    absent="; start it, or correct its address",
)


class AccessRefusedError(MqttError):
    """The broker refuses access, and waiting will not change that."""


class ConfiguredClient(MqttClient):
    """A connection to a broker that reports why it failed.

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
            MqttError: it is not there. Both state a remedy.
        """
        try:
            return await super().__aenter__()
        except MqttError as error:
            refused = is_refusal(error) or is_refusal(error.__cause__)
            kind = AccessRefusedError if refused else MqttError
            raise kind(reason_of(error, self._address, WORDING)) from error


async def subscribe_to_any(client: MqttClient, *filters: tuple[str, int]) -> None:
    """Subscribe to topic filters with a QoS each, of which some may be refused.

    Raises:
        MqttError: the connection is lost, or the broker allows none of them.
    """
    codes = await client.subscribe(*filters)
    if min(codes) < REFUSAL:
        return
    remedy = "; correct its access list, or username and password"
    raise MqttError(
        f"the broker refuses to send {filters[0][0]}: {sentence(codes[0], WORDING)}"
        f"{remedy if codes[0] == REFUSAL else ''}"
    )


@dataclass(frozen=True, slots=True)
class IncomingMessage:
    """A received message.

    Attributes:
        number: for its acknowledgement; 0 if none is needed.
        acknowledge: acknowledges, on the connection that it came by.
    """

    topic: str
    payload: bytes
    number: int
    acknowledge: Callable[[int], None]


class ManualAckConnection(ConfiguredClient):
    """A connection; use with `async with`, then wait for `wait_closed`.

    Args:
        take: called with each message.

    Attributes:
        is_useful: messages have come by it, besides those that a broker retains.
    """

    def __init__(
        self,
        address: BrokerAddress,
        take: Callable[[IncomingMessage], None],
        **options: Any,
    ) -> None:
        self.is_useful = False

        def received(message: Message) -> None:
            self.is_useful = self.is_useful or not message.retain
            take(
                IncomingMessage(
                    message.topic, message.payload, message.number, self.acknowledge
                )
            )

        handlers = Handlers(received=received)
        super().__init__(address, handlers=handlers, acknowledges=False, **options)


class ReconnectingConnection:
    """Maintains a connection and its subscriptions.

    Attributes:
        topics: topic filters to their quality of service.
        reason: why there is no connection, for people.
    """

    def __init__(self, address: BrokerAddress, **options: Any) -> None:
        self.address = address
        self._options = options
        self.topics: dict[str, int] = {}
        self.connections = 0
        self.reason = "no answer yet"
        self._settled = asyncio.Event()  # there was one, or waiting is in vain
        self._connection: ManualAckConnection | None = None
        self._certificates = CertificateWatch(
            lambda warning: logging.getLogger(CERTIFICATES_LOG).warning(
                "broker %s: %s", address, warning
            )
        )

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
            changed: called with True when there is a connection with all its
                subscriptions, and with False when it is lost.
        """
        loop = asyncio.get_running_loop()
        pause = GrowingPause(FIRST_WAIT_S, LAST_WAIT_S)
        while True:
            connected_s, connection = None, None
            try:
                async with ManualAckConnection(
                    self.address, take, **self._options
                ) as connection:
                    for topic, qos in self.topics.items():
                        await subscribe_to_any(connection, (topic, qos))
                    self._connection, connected_s = connection, loop.time()
                    self.connections += 1
                    self.reason = ""
                    self._settled.set()
                    changed(True)
                    while True:
                        self._certificates.check(connection.certificate_ends)
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(LOOK_S):
                                await connection.wait_closed()
            except (MqttError, OSError) as error:
                self._report_lost(str(error), changed)
                if isinstance(error, AccessRefusedError):
                    self._settled.set()
            finally:
                self._connection = None
            lasted_s = None if connected_s is None else loop.time() - connected_s
            if connection is not None and connection.is_useful:
                lasted_s = LASTING_S  # cut by the network: no time is to be lost
            await asyncio.sleep(pause.after(lasted_s))

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
        """Publish with quality of service 1.

        Raises:
            MqttError: there is no connection, or it broke before the acknowledgement.
        """
        if self._connection is None:
            raise MqttError(self.reason)
        await self._connection.publish(topic, payload, 1, retain=retain)

    def acknowledge(self, number: int) -> None:
        if self._connection is not None:
            self._connection.acknowledge(number)

    async def add_topic(self, topic: str, qos: int) -> None:
        self.topics[topic] = qos
        if self._connection is not None:
            await subscribe_to_any(self._connection, (topic, qos))

    def _report_lost(self, reason: str, changed: Callable[[bool], None]) -> None:
        was_up, self._connection = self._connection is not None, None
        if was_up or reason != self.reason:
            log.warning("broker %s: %s", self.address, reason)
        self.reason = reason
        if was_up:
            changed(False)
