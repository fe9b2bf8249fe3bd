"""An MQTT client that writes at once, and reports messages that the broker refuses.

aiomqtt passes a packet to the event loop, which watches the socket and writes it one
turn later: two wake-ups and two system calls more than necessary for each message. And
paho reads each packet by three calls; here one reads all that has arrived. aiomqtt 2.5
treats every PUBACK as a success; with MQTT 5 its reason code may be a
refusal, for example by an access list. Brokers of MQTT 3.1.1 cannot refuse.
"""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import MQTTMessage
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.diagnosing_client import DiagnosingClient
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.protocol.encoding import Encoding, content_type

RECEIVE_MAXIMUM = 32  # commands of QoS 1 on their way to us
READ_BYTES = 16_384
MAX_PACKET_BYTES = 65_536  # of a packet; what is beyond is read and forgotten
HEAD_BYTES = 2_097_152  # of topic and properties: cut within, they cannot be read


class CachedProperties(Properties):
    """What every message in one encoding carries; packed once, since that is slow."""

    def __init__(self, encoding: Encoding) -> None:
        super().__init__(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
        self.ContentType = content_type(encoding)
        # Past paho's own attributes, which are properties of MQTT.
        packed = super().pack()  # type: ignore[no-untyped-call]  # paho's is not typed
        object.__setattr__(self, "_packed", packed)

    def pack(self) -> bytes:
        """As they go into a packet."""
        packed: bytes = object.__getattribute__(self, "_packed")
        return packed


def publish_properties(encoding: Encoding) -> Properties:
    """What a message carries, to which more can be added."""
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ContentType = content_type(encoding)
    return properties


def connect_properties() -> Properties:
    """What we are ready to take in.

    No largest packet is announced: mosquitto 2.0.11 counts those that it withholds as
    on their way for ever, and after `RECEIVE_MAXIMUM` of them sends no command again.
    """
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ReceiveMaximum = RECEIVE_MAXIMUM
    return properties


MAX_IN_FLIGHT = 16  # paho holds back what is beyond 20


class BrokerClient(DiagnosingClient):
    """A client that has several messages on their way.

    Args:
        acknowledged: called with the number of each message that the broker has
            answered, and with its reason where it was refused.
        received: called with each message that arrives; aiomqtt's own queue takes a
            task for each, and loses what it has no room for.
        writable: called when a socket that took no more takes bytes again.

    Attributes:
        max_in_flight: so many messages may wait for their answers.
    """

    def __init__(
        self,
        *arguments: Any,
        acknowledged: Callable[[int, str | None], None] | None = None,
        received: Callable[[MQTTMessage], None] | None = None,
        writable: Callable[[], None] = lambda: None,
        **options: Any,
    ) -> None:
        super().__init__(*arguments, **options)
        self._read = self._client._sock_recv  # noqa: SLF001 - paho reads all of a packet
        self._client._sock_recv = self._receive_bytes  # type: ignore[method-assign]  # noqa: SLF001
        self._read_packets = self._client.loop_read
        self._client.loop_read = self._receive  # type: ignore[method-assign]
        self._unread = b""
        self._answers: list[tuple[int, str | None]] = []
        self._acknowledged = acknowledged
        self._received = received
        self._writable = writable
        self._is_sending = False
        self._own_thread = threading.current_thread()
        self.max_in_flight = MAX_IN_FLIGHT

    async def wait_closed(self) -> None:
        """Wait until the connection is closed.

        Raises:
            aiomqtt.MqttError: always, with the reason.
        """
        await asyncio.wait({self._disconnected})
        error = self._disconnected.exception()
        raise aiomqtt.MqttError("the connection was lost") from error

    @property
    def is_congested(self) -> bool:
        """Whether bytes wait that the socket did not take."""
        return self._client.want_write()

    def send(self, message: OutgoingMessage, properties: Properties | None) -> int:
        """Write a message now; gives its number, by which a broker answers at QoS 1.

        Raises:
            aiomqtt.MqttError: there is no connection any more.
            ValueError: nothing can be published on this topic.
        """
        self._is_sending = True  # or every packet would be watched for
        try:
            info = self._client.publish(
                message.topic, message.payload, message.qos, message.retain, properties
            )
            result = info.rc or self._client.loop_write()
        finally:
            self._is_sending = False
        if result != MQTTErrorCode.MQTT_ERR_SUCCESS:
            raise aiomqtt.MqttCodeError(result, "could not publish")
        if self.is_congested:
            self._watch()
        return info.mid

    @contextlib.contextmanager
    def corked(self) -> Iterator[None]:
        """What is sent within the block leaves at its end, in few packets.

        The broker is woken once, and each waking costs as much as encoding a message.
        """
        self._set_cork(True)
        try:
            yield
        finally:
            self._set_cork(False)

    def _set_cork(self, wanted: bool) -> None:
        sock = self._client.socket()
        if isinstance(sock, socket.socket):
            with contextlib.suppress(OSError):  # a dead one fails when written to
                sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_CORK, wanted)

    def _watch(self) -> None:
        sock = self._client.socket()
        if sock is not None:
            self._loop.add_writer(sock.fileno(), self._write)

    def _write(self) -> None:
        try:
            self._client.loop_write()
        except Exception as error:  # noqa: BLE001 - as aiomqtt: the connection is closed
            if not self._disconnected.done():
                self._disconnected.set_exception(error)
        if not self.is_congested:
            self._writable()

    def _on_connect(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt declares it
        flags: Any,  # noqa: ANN401 - as aiomqtt's
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        most = getattr(properties, "ReceiveMaximum", MAX_IN_FLIGHT)
        self.max_in_flight = min(MAX_IN_FLIGHT, most)
        super()._on_connect(client, userdata, flags, reason_code, properties)

    def _on_socket_register_write(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt's
        sock: Any,  # noqa: ANN401 - as aiomqtt's
    ) -> None:
        if self._is_sending:
            return  # it is written without watching
        if threading.current_thread() is self._own_thread:
            # At once: a deferred one could follow the writing, and stay for ever.
            self._watch()
        else:  # while connecting
            super()._on_socket_register_write(client, userdata, sock)

    def _receive(self, max_packets: int = 1) -> MQTTErrorCode:
        """Read all that has arrived; then process answers, not within paho's callback.

        Nothing can be sent there: it would wait for itself.
        """
        result = self._read_packets(max_packets)
        while self._unread and result == MQTTErrorCode.MQTT_ERR_SUCCESS:
            result = self._read_packets(max_packets)
        answers, self._answers = self._answers, []
        for mid, reason in answers:
            if self._acknowledged is not None:
                self._acknowledged(mid, reason)
        return result

    def _receive_bytes(self, bufsize: int) -> bytes:
        """Read a part of a packet; of one that is too long only the head is kept.

        It is read to its end: so the broker gets its answer, and sends the next one.
        """
        packet = self._client._in_packet["packet"]  # noqa: SLF001 - see above
        del packet[HEAD_BYTES:]
        if not self._unread:
            self._unread = self._read(READ_BYTES)
        data, self._unread = self._unread[:bufsize], self._unread[bufsize:]
        return data

    def _on_message(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt's
        message: MQTTMessage,
    ) -> None:
        if self._received is not None:
            message.payload = message.payload[:MAX_PACKET_BYTES]
            # Not within paho's callback, see `_receive`.
            self._loop.call_soon(self._received, message)

    def _on_publish(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt's
        mid: int,
        reason_code: ReasonCode,
        properties: Properties,
    ) -> None:
        if not self._is_sending:
            reason = str(reason_code) if reason_code.is_failure else None
            self._answers.append((mid, reason))
        super()._on_publish(client, userdata, mid, reason_code, properties)
