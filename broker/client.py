"""A client of an MQTT broker on the event loop, for the daemon and for all programs.

Strategy: `traverse.broker.packets` encodes, `traverse.broker.decoder` decodes, and
asyncio's transport moves the bytes. A message is written in the call that sends it.
Received data is processed for a few milliseconds at a time; the rest waits in the
socket, so that a flood slows down its sender and not the event loop.
"""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from datetime import datetime
from ssl import SSLContext
from typing import Self, cast

from traverse.broker.certificates import OF_BROKER, end_of_peer
from traverse.broker.decoder import PacketDecoder, PacketError
from traverse.broker.errors import (
    ClosedBeforeAnswerError,
    ConnectRefusedError,
    DisconnectedError,
    MqttError,
    RefusedError,
    end_of_connection,
)
from traverse.broker.inbox import Inbox, first_of
from traverse.broker.keep_alive import KeepAlive
from traverse.broker.limits import BrokerLimits
from traverse.broker.packets import (
    DISCONNECT,
    Acknowledged,
    Connected,
    Disconnected,
    Message,
    Packet,
    Properties,
    Property,
    Version,
    acknowledgement_packet,
    connect_packet,
    packed_properties,
    publish_packet,
    subscribe_packet,
    unsubscribe_packet,
)
from traverse.broker.resolver import connect_to_host

TIMEOUT_S = 5.0
TURN_NS = 2_000_000  # in which packets are processed before others have the event loop
MAX_IN_FLIGHT = 16
MAX_PAYLOAD_BYTES = 16_777_216
REFUSAL = 0x80  # reason codes from here on say no, in MQTT 3.1.1 and 5
LAST_NUMBER = 65_535
READ_BYTES = 65_536


@dataclass(frozen=True, slots=True)
class Handlers:
    """Callbacks of a client, on the event loop; none may wait.

    Attributes:
        received: for each message; without it they are in `MqttClient.messages`.
        acknowledged: for each message of QoS 1 sent by `MqttClient.send`: its number,
            and the reason code where the broker refused it.
        writable: when a full socket takes bytes again.
    """

    received: Callable[[Message], None] | None = None
    acknowledged: Callable[[int, int | None], None] | None = None
    writable: Callable[[], None] = lambda: None


@dataclass(eq=False)
class MqttClient(asyncio.BufferedProtocol):
    """One connection to a broker; use with `async with`.

    Args:
        identifier: unique at the broker; it may be empty with ``clean_start``.
        clean_start: the broker drops earlier subscriptions and messages.
        connect_properties: properties of CONNECT (MQTT 5).
        file_ends: when the certificates of its files end, by their names.
        acknowledges: acknowledge messages as soon as they have been handled; else
            call `acknowledge`.
        max_payload_bytes: longer payloads are cut.

    Attributes:
        limits: limits of the broker, known once there is a connection.
        inbox: messages that no handler takes.
    """

    hostname: str
    port: int
    _: KW_ONLY
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    tls_context: SSLContext | None = None
    file_ends: Mapping[str, datetime] = field(default_factory=dict)
    keep_alive_s: int = 10
    identifier: str = ""
    version: Version = Version.V311
    clean_start: bool = True
    will: Message | None = None
    connect_properties: Properties = field(default_factory=dict)
    handlers: Handlers = field(default_factory=Handlers)
    acknowledges: bool = True
    max_payload_bytes: int = MAX_PAYLOAD_BYTES

    def __post_init__(self) -> None:
        self.limits = BrokerLimits()
        self._decoder = PacketDecoder(self.version, self.max_payload_bytes)
        self._transport: asyncio.Transport | None = None
        self._number = 0
        self._awaited: dict[int, asyncio.Future[tuple[int, ...]]] = {}
        self._has_room = asyncio.Event()
        loop = self._loop = asyncio.get_running_loop()
        self._connected: asyncio.Future[Connected] = loop.create_future()
        self._closed: asyncio.Future[MqttError] = loop.create_future()
        self.inbox = Inbox(self._closed)
        self._ended_by: MqttError | None = None
        self._is_behind = False
        self._buffer = memoryview(bytearray(READ_BYTES))
        self._keep_alive = KeepAlive(self.write, self._end)

    # -- the connection -------------------------------------------------------

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            MqttError: there is no connection; the cause is the error of the system.
        """
        try:
            async with asyncio.timeout(TIMEOUT_S):
                await connect_to_host(
                    lambda: self, self.hostname, self.port, self.tls_context
                )
                await first_of(self._connected, self._closed)
            if not self._connected.done():
                raise self._closed.result()
            self._take_answer(self._connected.result())
        except TimeoutError as error:
            self._abort()
            raise MqttError("no answer") from error
        except OSError as error:
            raise MqttError(str(error)) from error
        except BaseException:
            self._abort()
            raise
        return self

    async def __aexit__(self, *error: object) -> None:
        """Disconnect, so that no will is published, and close."""
        if self._transport is None or self._closed.done():
            return
        self._transport.write(DISCONNECT)
        self._transport.close()
        try:
            async with asyncio.timeout(1.0):
                await asyncio.wait({self._closed})
        except TimeoutError:
            self._abort()

    async def wait_closed(self) -> None:
        """Wait until the connection has ended.

        Raises:
            MqttError: always, with the reason.
        """
        await asyncio.wait({self._closed})
        raise self._closed.result()

    def _take_answer(self, answer: Connected) -> None:
        if answer.code:
            reason = answer.properties.get(Property.REASON_STRING, "")
            raise ConnectRefusedError(answer.code, str(reason))
        self.limits = BrokerLimits.of(answer.properties)
        self._keep_alive.start(min(self.keep_alive_s, self.limits.keep_alive_s))

    def _abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()

    def _end(self, error: MqttError) -> None:
        self._ended_by = self._ended_by or error
        self._abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Send CONNECT."""
        # Those of uvloop, which the page runs on, are no subclass.
        stream = self._transport = cast("asyncio.Transport", transport)
        stream.set_write_buffer_limits(0)
        stream.write(
            connect_packet(
                self.identifier,
                self.version,
                self.keep_alive_s,
                clean_start=self.clean_start,
                username=self.username,
                password=self.password,
                will=self.will,
                properties=self.connect_properties,
            )
        )

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail everything that waits for an answer."""
        self._keep_alive.stop()
        is_answered = self._connected.done()
        error = self._ended_by or end_of_connection(exc, is_answered=is_answered)
        self._closed.set_result(error)
        for waiting in self._awaited.values():
            if not waiting.done():
                waiting.set_exception(error)
        self._awaited.clear()
        self._has_room.set()

    # -- sending --------------------------------------------------------------

    @property
    def max_in_flight(self) -> int:
        """Number of messages that may wait for their acknowledgement."""
        return min(MAX_IN_FLIGHT, self.limits.receive_maximum)

    @property
    def is_congested(self) -> bool:
        return self._transport is not None and (
            self._transport.get_write_buffer_size() > 0
        )

    @property
    def certificate_ends(self) -> Mapping[str, datetime]:
        """When certificates of the connection end, by their names."""
        tls = None
        if self._transport is not None:
            tls = self._transport.get_extra_info("ssl_object")
        if (end := end_of_peer(tls)) is None:
            return self.file_ends
        return {**self.file_ends, OF_BROKER: end}

    def next_number(self) -> int:
        """Packet identifier that no `publish` or `subscribe` waits for."""
        while True:
            self._number = self._number % LAST_NUMBER + 1
            if self._number not in self._awaited:
                return self._number

    def write(self, data: bytes) -> None:
        """Write packets now; the transport keeps bytes that the socket does not take.

        Raises:
            MqttError: there is no connection any more.
        """
        if self._closed.done():
            raise self._closed.result()
        if self._transport is None:
            raise MqttError("not connected")
        self._transport.write(data)

    def resume_writing(self) -> None:
        self.handlers.writable()

    async def publish(
        self,
        topic: str,
        payload: bytes,
        qos: int = 0,
        *,
        retain: bool = False,
        properties: Properties | None = None,
    ) -> None:
        """Publish a message; at QoS 1 wait until the broker has it.

        Raises:
            RefusedError: the broker does not take it.
            MqttError: the connection is lost.
            ValueError: nothing can be published on this topic.
        """
        packed = b""
        if self.version is Version.V5:
            packed = packed_properties(properties or {})
        while qos and len(self._awaited) >= self.max_in_flight:
            self._has_room.clear()
            await self._has_room.wait()
            if self._closed.done():
                raise self._closed.result()
        number = self.next_number() if qos else 0
        packet = publish_packet(
            topic, payload, qos=qos, retain=retain, number=number, properties=packed
        )
        if not qos:
            self.write(packet)
            return
        (code,) = await self._answer_to(number, packet, 1)
        if code >= REFUSAL:
            raise RefusedError(code)

    async def subscribe(self, *filters: tuple[str, int]) -> tuple[int, ...]:
        """Subscribe to topic filters with a QoS each; return the broker's codes.

        Codes from `REFUSAL` on are refusals.

        Raises:
            MqttError: the connection is lost, or there is no answer.
        """
        number = self.next_number()
        packet = subscribe_packet(filters, number, self.version)
        try:
            async with asyncio.timeout(TIMEOUT_S):
                return await self._answer_to(number, packet, len(filters))
        except TimeoutError as error:
            raise MqttError("no answer to a subscription") from error

    def unsubscribe(self, filters: Sequence[str]) -> None:
        """Unsubscribe without waiting; messages on their way still arrive.

        Raises:
            MqttError: the connection is lost.
        """
        self.write(unsubscribe_packet(filters, self.next_number(), self.version))

    def acknowledge(self, number: int) -> None:
        """Acknowledge a received message; one of a lost connection is sent again."""
        with contextlib.suppress(MqttError):
            self.write(acknowledgement_packet(number))

    async def _answer_to(
        self, number: int, packet: bytes, n_codes: int
    ) -> tuple[int, ...]:
        answer: asyncio.Future[tuple[int, ...]] = self._loop.create_future()
        self._awaited[number] = answer
        try:
            self.write(packet)
            codes = await answer
            if len(codes) != n_codes:
                raise MqttError(
                    f"the broker sends no MQTT: an answer of {len(codes)} codes in "
                    f"place of {n_codes}"
                )
            return codes
        finally:
            self._awaited.pop(number, None)
            self._has_room.set()

    # -- receiving ------------------------------------------------------------

    @property
    def messages(self) -> AsyncIterator[Message]:
        """Messages as they arrive, unless a handler takes them; see `Inbox`."""
        return self.inbox.messages()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._keep_alive.is_heard = True
        self._decoder.feed(self._buffer[:nbytes])
        if not self._is_behind:
            self._process()

    def _process(self) -> None:
        """Process packets for a while; go on in the next turn of the event loop."""
        transport = self._transport
        if transport is None or self._closed.done():
            return
        until_ns = time.monotonic_ns() + TURN_NS
        try:
            for packet in self._decoder.packets():
                self._take(packet)
                if time.monotonic_ns() > until_ns:
                    if not self._is_behind:
                        self._is_behind = True
                        transport.pause_reading()
                    self._loop.call_soon(self._process)
                    return
        except PacketError as error:
            if self._connected.done():
                self._end(MqttError(f"the broker sends no MQTT: {error}"))
            else:
                self._end(ClosedBeforeAnswerError())  # an alert of TLS, say
            return
        if self._is_behind:
            self._is_behind = False
            transport.resume_reading()

    def _take(self, packet: Packet) -> None:
        match packet:
            case Acknowledged(number, codes):
                self._take_acknowledgement(number, codes)
            case Message():
                self._take_message(packet)
            case Connected():
                if not self._connected.done():
                    self._connected.set_result(packet)
            case Disconnected(code, properties):
                reason = properties.get(Property.REASON_STRING, "")
                self._end(DisconnectedError(code, str(reason)))

    def _take_acknowledgement(self, number: int, codes: tuple[int, ...]) -> None:
        if (answer := self._awaited.get(number)) is not None:
            if not answer.done():
                answer.set_result(codes)
        elif self.handlers.acknowledged is not None:
            code = codes[0] if codes else 0
            self.handlers.acknowledged(number, code if code >= REFUSAL else None)

    def _take_message(self, message: Message) -> None:
        if self.handlers.received is not None:
            self.handlers.received(message)
        else:
            self.inbox.put(message)
        if self.acknowledges and message.number:
            self.acknowledge(message.number)
