"""Keep the connection to the broker: one method publishes; it reconnects by itself.

MQTT 5 where the broker speaks it, else 3.1.1 (version 5 properties are never needed to
decode). A message leaves its queue only after the broker has taken it.
"""

import asyncio
import contextlib
import logging
import os
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from typing import Any, Literal

from traverse.broker.address import BrokerAddress
from traverse.broker.client import Handlers, MqttClient
from traverse.broker.credentials import (
    Credentials,
    CredentialsError,
    connection_options,
    read_credentials,
)
from traverse.broker.errors import (
    ClosedBeforeAnswerError,
    ConnectRefusedError,
    MqttError,
)
from traverse.broker.packets import (
    Message,
    Property,
    PropertyValue,
    Version,
    packed_properties,
)
from traverse.broker.pause import GrowingPause
from traverse.broker.reasons import VERSION_REFUSED, reason_of
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.mqtt.sender import PublishLoop
from traverse.daemon.mqtt.subscriber import (
    MAX_COMMAND_PAYLOAD_BYTES,
    CommandSubscriber,
    IncomingCommand,
)
from traverse.daemon.mqtt.wording import WORDING
from traverse.protocol.encoding import Encoding, content_type
from traverse.protocol.messages import BrokerHealth

log = logging.getLogger(__name__)

QUEUED = ("point", "event", "resend", "spooled", "scan")
FIRST_RETRY_S = 0.2
LAST_RETRY_S = 5.0
SHORT_LIVED = 3  # in a row: then it is no accident
RECEIVE_MAXIMUM = 32  # commands of QoS 1 on their way to us
SESSION_S = 60  # so long a broker keeps commands for a lost connection of this run
RETAIN_REFUSED, QOS_REFUSED = 0x9A, 0x9B  # reason codes
CONNECTION_FAILURES = (MqttError, OSError, CredentialsError)


@lru_cache(maxsize=64)  # nearly all messages have the same
def publish_properties(
    encoding: Encoding, correlation: bytes | None = None, expiry_s: int | None = None
) -> bytes:
    """Packed properties of a message of MQTT 5."""
    properties: dict[int, PropertyValue] = {
        Property.CONTENT_TYPE: content_type(encoding)
    }
    if correlation is not None:
        properties[Property.CORRELATION] = correlation
    if expiry_s is not None:
        properties[Property.MESSAGE_EXPIRY_S] = expiry_s
    return packed_properties(properties)


async def run_until_first(*works: Coroutine[Any, Any, object]) -> None:
    """Run coroutines until the first of them ends; raise its error."""
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
    """Keep a connection, send the queue, pass on received messages.

    Args:
        client_id: unique for the arm; of two clients with one id each ends the other.
        will: message that the broker publishes when this client vanishes.
        encoding: encoding of payloads, announced as MQTT 5 content type.
        subscriptions: topic filters, see `CommandSubscriber`.
        changed: called when the connection is up (True) or lost (False, reason).
        least_retry_s: returns the least time to stay away after a loss [s].
        limit_exceeded: called with a kind of messages, and what becomes of those that
            are longer than the broker takes, or nothing where all are short enough.

    Attributes:
        state_known: set as soon as the connection is up, or has failed.
        certificate_ends: of the connection, by their names.
    """

    address: BrokerAddress
    client_id: str
    will: OutgoingMessage
    encoding: Encoding
    queue: OutgoingQueue
    subscriptions: Sequence[str]
    changed: Callable[[bool, str], None]
    least_retry_s: Callable[[], float] = lambda: 0.0
    limit_exceeded: Callable[[str, str], None] = lambda kind, text: None

    def __post_init__(self) -> None:
        self._access: Credentials | None = None
        self._version = Version.V5
        self._renewal = asyncio.Event()
        self._has_session = False
        self._warned: set[str] = set()
        self.state: Literal["connecting", "connected", "lost"] = "connecting"
        self.state_known = asyncio.Event()
        self.certificate_ends: Mapping[str, datetime] = {}
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
        """Connect once and leave; return the reason if that was impossible."""
        try:
            async with self._connection():
                return None
        except CONNECTION_FAILURES as error:
            return reason_of(error, self.address, WORDING)

    def renew(self) -> None:
        """Reconnect if password or certificates have changed."""
        self._renewal.set()

    async def run(self, receive: Callable[[IncomingCommand], float | None]) -> None:
        """Connect, send and receive; reconnect after every loss; until cancelled.

        ``receive`` is called with each command; see `CommandSubscriber`.
        """
        loop = asyncio.get_running_loop()
        subscriber = CommandSubscriber(self.subscriptions, receive)
        pause = GrowingPause(FIRST_RETRY_S, LAST_RETRY_S)
        connected_before = False
        last_reason = ""
        while True:
            connected_s: float | None = None
            try:
                publish_loop = PublishLoop(
                    self.queue,
                    properties=self._properties,
                    changed=self.changed,
                    limit_exceeded=self.limit_exceeded,
                    broker=str(self.address),
                )
                handlers = Handlers(
                    received=subscriber.on_message,
                    acknowledged=publish_loop.on_acknowledged,
                    writable=publish_loop.send,
                )
                async with self._connection(handlers) as client:
                    connected_s = loop.time()
                    self.certificate_ends = client.certificate_ends
                    self.reconnects += connected_before
                    connected_before, last_reason = True, ""
                    await subscriber.subscribe(client)
                    self._has_session = self._version is Version.V5
                    self.state = "connected"
                    self.state_known.set()
                    self.changed(True, f"broker {self.address} connected")
                    if subscriber.refusal:
                        text = f"broker {self.address} {subscriber.refusal}"
                        self.changed(False, text)
                    await run_until_first(
                        publish_loop.run(client),
                        client.wait_closed(),
                        subscriber.run(),
                        self._wait_for_changed_files(),
                    )
                    continue  # immediately: with the new certificates
            except CONNECTION_FAILURES as error:
                reason = reason_of(error, self.address, WORDING)
                lasted_s = None if connected_s is None else loop.time() - connected_s
                pause_s = max(pause.after(lasted_s), self.least_retry_s())
                if pause.n_short_lived >= SHORT_LIVED:
                    reason += (
                        "; it does so each time soon after connecting: its log has the "
                        "reason (access list, limits, retained messages?)"
                    )
                if self.state == "connected" or reason != last_reason:
                    self.state, last_reason = "lost", reason
                    self.state_known.set()
                    self.changed(False, f"broker {self.address}: {reason}")
            await asyncio.sleep(pause_s)

    async def _wait_for_changed_files(self) -> None:
        """Wait until password or certificates have changed since connecting."""
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
        """Packed properties of a message (MQTT 5)."""
        return publish_properties(
            message.encoding or self.encoding, message.correlation, message.expiry_s
        )

    @contextlib.asynccontextmanager
    async def _connection(
        self, handlers: Handlers | None = None
    ) -> AsyncIterator[MqttClient]:
        """Connect with the newest version that the broker speaks.

        Without handlers it has no will, to try the broker only. A broker of MQTT 3.1.1
        may refuse version 5 with a code, or close the connection; one may have been
        updated since. The other version is tried then.
        """
        async with contextlib.AsyncExitStack() as stack:
            try:
                client = await self._client(handlers)
                await stack.enter_async_context(client)
            except (ConnectRefusedError, ClosedBeforeAnswerError) as error:
                code = getattr(error, "code", None)
                if code is not None and code not in VERSION_REFUSED:
                    raise
                is_5 = self._version is Version.V5
                self._version = Version.V311 if is_5 else Version.V5
                client = await self._client(handlers)
                await stack.enter_async_context(client)
            if not client.limits.retain_available:
                raise ConnectRefusedError(RETAIN_REFUSED)
            if not client.limits.maximum_qos:
                raise ConnectRefusedError(QOS_REFUSED)
            yield client

    async def _client(self, handlers: Handlers | None) -> MqttClient:
        is_probe = handlers is None
        access = await asyncio.to_thread(read_credentials, self.address)
        self._access = access
        for text in access.warnings:
            if text not in self._warned:
                log.warning("%s", text)
        self._warned.update(access.warnings)
        will = Message(self.will.topic, self.will.payload, qos=1, retain=True)
        return MqttClient(
            **connection_options(self.address, access),
            # Not where the broker is only tried: one of MQTT 3.1.1 that does not look
            # at the version first would stumble over them. No largest packet is
            # announced: mosquitto 2.0.11 counts those that it withholds as on their way
            # for ever, and after so many of them sends no command again.
            connect_properties={}
            if is_probe
            else {
                Property.RECEIVE_MAXIMUM: RECEIVE_MAXIMUM,
                Property.SESSION_EXPIRY_S: SESSION_S,
            },
            # Commands that waited for the connection are answered, most of them as
            # expired; those for an earlier run are not.
            clean_start=is_probe or not self._has_session,
            # A probe must not throw a running daemon of this arm out.
            identifier=self.client_id + (f"-{os.getpid()}" if is_probe else ""),
            version=self._version,
            will=None if is_probe else will,
            handlers=handlers or Handlers(),
            max_payload_bytes=MAX_COMMAND_PAYLOAD_BYTES,
        )
