"""An MQTT client that writes at once, and reports messages that the broker refuses.

aiomqtt passes a packet to the event loop, which watches the socket and writes it one
turn later: two wake-ups and two system calls more than necessary for each message. paho
keeps each message with locks and events of its own, and reads each packet by three
calls. So messages and the answers to them are written and read here; all else, and the
connection itself, is paho's. aiomqtt 2.5 treats every PUBACK as a success; with MQTT 5
its reason code may be a refusal, for example by an access list. Brokers of MQTT 3.1.1
cannot refuse.
"""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import MQTTMessage
from paho.mqtt.enums import MessageType, MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties, VariableByteIntegers
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.diagnosing_client import DiagnosingClient
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.protocol.encoding import Encoding, content_type

RECEIVE_MAXIMUM = 32  # commands of QoS 1 on their way to us
READ_BYTES = 16_384
WRITE_BYTES = 65_536  # more is not collected
MAX_PACKET_BYTES = 65_536  # of a packet; what is beyond is read and forgotten
HEAD_BYTES = 2_097_152  # of topic and properties: cut within, they cannot be read


@lru_cache(maxsize=64)  # packing is slow, and nearly all messages have the same
def publish_properties(
    encoding: Encoding, correlation: bytes | None = None, expiry_s: int | None = None
) -> bytes:
    """Properties of a message of MQTT 5, as they go into its packet."""
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ContentType = content_type(encoding)
    if correlation is not None:
        properties.CorrelationData = correlation
    if expiry_s is not None:
        properties.MessageExpiryInterval = expiry_s
    packed: bytes = properties.pack()  # type: ignore[no-untyped-call]  # paho's is not typed
    return packed


def publish_packet(message: OutgoingMessage, number: int, properties: bytes) -> bytes:
    """A packet PUBLISH (MQTT 5.0, section 3.3).

    The packet's number is not in one of QoS 0; properties are packed, and empty in MQTT
    3.1.1.

    Raises:
        ValueError: nothing can be published on this topic.
    """
    topic = message.topic.encode()
    if not 0 < len(topic) < 1 << 16 or b"#" in topic or b"+" in topic:
        raise ValueError("is no topic that can be published on")
    head = len(topic).to_bytes(2) + topic
    if message.qos:
        head += number.to_bytes(2)
    head += properties
    length: bytes = VariableByteIntegers.encode(len(head) + len(message.payload))  # type: ignore[no-untyped-call]  # paho's is not typed
    first = MessageType.PUBLISH | message.qos << 1 | message.retain
    return bytes((first,)) + length + head + message.payload


def connect_properties() -> Properties:
    """What we are ready to take in.

    No largest packet is announced: mosquitto 2.0.11 counts those that it withholds as
    on their way for ever, and after `RECEIVE_MAXIMUM` of them sends no command again.
    """
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ReceiveMaximum = RECEIVE_MAXIMUM
    return properties


MAX_IN_FLIGHT = 16


def refusal(reason: int) -> str | None:
    """Why a message was refused, by the reason code of its answer; None: it was not."""
    if reason < 0x80:
        return None
    try:
        return str(ReasonCode(PacketTypes.PUBACK, identifier=reason))
    except KeyError:
        return f"reason code {reason:#04x}"


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
        self._failure: OSError | None = None  # of reading
        self._unwritten = bytearray()
        self._gathers = False
        self._acknowledged = acknowledged
        self._received = received
        self._writable = writable
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

    def send(self, message: OutgoingMessage, properties: bytes) -> int:
        """Write a message now; gives its number, by which a broker answers at QoS 1.

        Properties of MQTT 5 are packed; in 3.1.1 they are empty.

        Raises:
            aiomqtt.MqttError: there is no connection any more.
            ValueError: nothing can be published on this topic.
        """
        # Its own numbers are from the same counter, so that none is used twice.
        number = self._client._mid_generate() if message.qos else 0  # noqa: SLF001
        packet = publish_packet(message, number, properties)
        self._unwritten += packet
        if not self._gathers or len(self._unwritten) > WRITE_BYTES:
            self._write()
        return number

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """What is sent within the block is written at its end, all at once.

        The broker is woken once, and each waking costs as much as encoding a message.

        Raises:
            aiomqtt.MqttError: there is no connection any more.
        """
        self._gathers = True
        try:
            yield
        finally:
            self._gathers = False
            if self._unwritten:
                self._write()

    def _write(self) -> None:
        """Write what was sent; paho writes what the socket does not take now."""
        client, data, n_written = self._client, bytes(self._unwritten), 0
        self._unwritten.clear()
        try:
            if not self.is_congested:
                n_written = client._sock_send(data)  # noqa: SLF001 - also with TLS
        except BlockingIOError:
            pass
        except OSError as error:
            raise aiomqtt.MqttError(f"could not publish: {error}") from error
        if n_written < len(data):
            client._packet_queue(MessageType.PUBLISH, data[n_written:], mid=0, qos=1)  # noqa: SLF001

    def _watch(self) -> None:
        sock = self._client.socket()
        if sock is not None:
            self._loop.add_writer(sock.fileno(), self._write_rest)

    def _write_rest(self) -> None:
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
        if threading.current_thread() is self._own_thread:
            # At once: a deferred one could follow the writing, and stay for ever.
            self._watch()
        else:  # while connecting
            super()._on_socket_register_write(client, userdata, sock)

    def _receive(self, max_packets: int = 1) -> MQTTErrorCode:
        """Read all that has arrived; paho reads what is no answer to a message."""
        result = MQTTErrorCode.MQTT_ERR_SUCCESS
        try:
            data = self._read(READ_BYTES)
        except BlockingIOError:
            return result
        except OSError as error:
            self._failure, data = error, b""
        self._unread += data
        is_end = not data  # paho is to report it
        while self._take_answers() or is_end:
            is_end = False
            result = self._read_packets(max_packets)
            if result != MQTTErrorCode.MQTT_ERR_SUCCESS:
                break
        return result

    def _take_answers(self) -> bool:
        """Process answers up to the next other packet; whether there is one."""
        if self._client._in_packet["command"]:  # noqa: SLF001 - it is half read
            return bool(self._unread)
        while (data := self._unread) and data[0] == MessageType.PUBACK:
            if len(data) < 2 or len(data) < (end := 2 + data[1]):
                return False  # the rest of it has not arrived
            if not 4 <= end < 130:
                return True  # the length has one byte; paho reports what is wrong
            number = int.from_bytes(data[2:4])
            reason = data[4] if end > 4 else 0
            self._unread = data[end:]
            if self._acknowledged is not None:
                self._acknowledged(number, refusal(reason))
        return bool(self._unread)

    def _receive_bytes(self, bufsize: int) -> bytes:
        """Read a part of a packet; of one that is too long only the head is kept.

        It is read to its end: so the broker gets its answer, and sends the next one.
        """
        packet = self._client._in_packet["packet"]  # noqa: SLF001 - see above
        del packet[HEAD_BYTES:]
        if not self._unread:
            if self._failure is not None:
                raise self._failure
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
