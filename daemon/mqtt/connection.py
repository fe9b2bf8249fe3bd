"""The connection to the broker: one method to publish, everything else by itself.

MQTT 5 where the broker speaks it, else 3.1.1 (its properties are a courtesy, never
needed to decode). A message leaves its queue only after the broker has taken it.
"""

import asyncio
import contextlib
import logging
import os
import random
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.address import BrokerAddress
from traverse.broker.credentials import (
    Credentials,
    CredentialsError,
    connection_options,
    read_credentials,
)
from traverse.broker.reasons import CUT_OFF, Wording, reason_code
from traverse.broker.reasons import reason_of as connect_error_text
from traverse.daemon.mqtt.client import (
    BrokerClient,
    connect_properties,
    publish_properties,
)
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.mqtt.sender import PublishLoop
from traverse.daemon.mqtt.subscriber import CommandSubscriber, IncomingCommand
from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import BrokerHealth

WORDING = Wording(
    who="this arm",
    where=" of [broker]",
    use_tls="set tls = true in [broker]",
    absent="",  # an event has its remedy beside it
)
# Why a connection has ended; paho gives 128 where it was cut.
_DISCONNECT_REASONS = {
    128: CUT_OFF,
    137: "the broker is too busy",
    139: "the broker is shutting down",
    141: "nothing was received for longer than keepalive_s of [broker]",
    142: "another client connected with this arm's client id; is there a second "
    "daemon of this name?",
    152: "the connection was ended at the broker",
}


def reason_of(error: BaseException, address: BrokerAddress) -> str:
    """Describe the failure of a connection for users."""
    for one in (error, error.__cause__ or error.__context__):
        match one:
            case aiomqtt.MqttCodeError(rc=ReasonCode(packetType=of, value=code)):
                if of == PacketTypes.DISCONNECT and code in _DISCONNECT_REASONS:
                    return _DISCONNECT_REASONS[code]
    return connect_error_text(error, address, WORDING)


log = logging.getLogger(__name__)

QUEUED = ("point", "event", "resend", "spooled", "scan")
FIRST_RETRY_S = 0.2
LAST_RETRY_S = 5.0
UNSUPPORTED_VERSION = (132, 1)  # reason code of MQTT 5, return code of MQTT 3.1.1


CONNECTION_FAILURES = (aiomqtt.MqttError, OSError, CredentialsError)


async def run_until_first(*works: Coroutine[Any, Any, object]) -> None:
    """Do all of this until the first of it ends; raises what has failed."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
    for result in results:
        if isinstance(result, Exception):
            raise result


@dataclass(eq=False, kw_only=True)
class BrokerConnection:
    """Keep a connection, send the queue, pass on what is received.

    Args:
        client_id: unique for the arm; two clients with one name fight.
        will: what the broker publishes when this client vanishes.
        encoding: of the payloads, announced as MQTT 5 content type.
        subscriptions: topic filters, see `CommandSubscriber`.
        changed: called when the connection is up (True) or lost (False, reason).
        least_retry_s: tells how long to stay away after a loss, at least [s].

    Attributes:
        state_known: set as soon as the connection is up, or has failed.
    """

    address: BrokerAddress
    client_id: str
    will: OutgoingMessage
    encoding: Encoding
    queue: OutgoingQueue
    subscriptions: Sequence[str]
    changed: Callable[[bool, str], None]
    least_retry_s: Callable[[], float] = lambda: 0.0

    def __post_init__(self) -> None:
        self._version = aiomqtt.ProtocolVersion.V5
        self._access: Credentials | None = None
        self._renewal = asyncio.Event()
        self._warned: set[str] = set()
        self.state: Literal["connecting", "connected", "lost"] = "connecting"
        self.state_known = asyncio.Event()
        self.reconnects = 0

    def health(self) -> BrokerHealth:
        """How the connection is, and what waits for it."""
        queue = self.queue
        return BrokerHealth(
            state=self.state,
            host=self.address.host,
            port=self.address.tcp_port,
            reconnects=self.reconnects,
            queued=sum(queue.waiting(kind) for kind in QUEUED),
            queue_limit=queue.limit,
            unacknowledged=queue.waiting("point"),
            dropped=sum(queue.dropped[kind] for kind in ("event", "scan", "reply")),
        )

    async def probe(self) -> str | None:
        """Connect once and leave; None, or why that was not possible."""
        try:
            async with self._connection():
                return None
        except CONNECTION_FAILURES as error:
            return reason_of(error, self.address)

    def renew(self) -> None:
        """Connect anew if password or certificates have changed since the last time."""
        self._renewal.set()

    async def run(self, receive: Callable[[IncomingCommand], float | None]) -> None:
        """Connect, send and receive; reconnect after every loss; until cancelled.

        ``receive`` is called with each command; see `CommandSubscriber`.
        """
        subscriber = CommandSubscriber(self.subscriptions, receive)
        retry_s = FIRST_RETRY_S
        connected_before = False
        last_reason = ""
        while True:
            try:
                publish_loop = PublishLoop(
                    self.queue,
                    properties=self._properties,
                    changed=self.changed,
                    broker=str(self.address),
                )
                handlers: Mapping[str, Callable[..., None]] = {
                    "acknowledged": publish_loop.on_acknowledged,
                    "writable": publish_loop.send,
                    "received": subscriber.on_message,
                }
                async with self._connection(handlers) as client:
                    self.reconnects += connected_before
                    connected_before, retry_s, last_reason = True, FIRST_RETRY_S, ""
                    await subscriber.subscribe(client)
                    self.state = "connected"
                    self.state_known.set()
                    self.changed(True, f"broker {self.address} connected")
                    await run_until_first(
                        publish_loop.run(client),
                        client.wait_closed(),
                        subscriber.run(client),
                        self._wait_for_changed_files(),
                    )
                    continue  # immediately: new certificates, or a flood of commands
            except CONNECTION_FAILURES as error:
                reason = reason_of(error, self.address)
                if self.state == "connected" or reason != last_reason:
                    self.state, last_reason = "lost", reason
                    self.state_known.set()
                    self.changed(False, f"broker {self.address}: {reason}")
            # Jitter prevents a fleet from reconnecting all at once.
            pause_s = max(retry_s, self.least_retry_s()) * random.uniform(0.5, 1.0)
            await asyncio.sleep(pause_s)
            retry_s = min(2 * retry_s, LAST_RETRY_S)

    async def _wait_for_changed_files(self) -> None:
        """Wait until the files that open the broker are others than at connecting."""
        while True:
            await self._renewal.wait()
            self._renewal.clear()
            try:
                now = await asyncio.to_thread(read_credentials, self.address)
            except CredentialsError as error:
                log.warning("%s; the connection continues unchanged", error)
                continue
            if self._access is None or now.digest != self._access.digest:
                log.info("password or certificates have changed; connecting anew")
                return

    def _properties(self, message: OutgoingMessage) -> bytes:
        if self._version is not aiomqtt.ProtocolVersion.V5:
            return b""
        encoding = message.encoding or self.encoding
        return publish_properties(encoding, message.correlation, message.expiry_s)

    @contextlib.asynccontextmanager
    async def _connection(
        self, handlers: Mapping[str, Callable[..., None]] | None = None
    ) -> AsyncIterator[BrokerClient]:
        """A connection in the newest version that the broker speaks.

        Without handlers of `BrokerClient` it has no will, only to try the broker.
        """
        async with contextlib.AsyncExitStack() as stack:
            try:
                client = await stack.enter_async_context(await self._client(handlers))
            except aiomqtt.MqttCodeError as error:
                if reason_code(error) not in UNSUPPORTED_VERSION:
                    raise
                self._version = aiomqtt.ProtocolVersion.V311
                client = await stack.enter_async_context(await self._client(handlers))
            yield client

    async def _client(
        self, handlers: Mapping[str, Callable[..., None]] | None
    ) -> BrokerClient:
        will = handlers is not None
        access = await asyncio.to_thread(read_credentials, self.address)
        self._access = access
        for text in access.warnings:
            if text not in self._warned:
                log.warning("%s", text)
        self._warned.update(access.warnings)
        is_5 = self._version is aiomqtt.ProtocolVersion.V5
        client = BrokerClient(
            **connection_options(self.address, access),
            # Not where the broker is only tried: one of MQTT 3.1.1 that does not look
            # at the version first would stumble over them.
            properties=connect_properties() if is_5 and will else None,
            # A probe must not throw a running daemon of this arm out.
            identifier=self.client_id if will else f"{self.client_id}-{os.getpid()}",
            protocol=self._version,
            will=aiomqtt.Will(self.will.topic, self.will.payload, 1, True)
            if will
            else None,
            **(handlers or {}),
        )
        client.pending_calls_threshold = 1000
        return client
