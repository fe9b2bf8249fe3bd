"""Packets of MQTT 3.1.1 and 5 as a client writes and reads them; bytes only.

Quality of service 2, topic aliases and extended authentication are not supported: a
client that announces none of them is sent none. Sections are those of the OASIS
standard "MQTT Version 5.0".
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

MAX_LENGTH = 268_435_455  # of a packet, section 1.5.5
HEAD_BYTES = 200_000  # topic and ordinary properties of a message that is cut
MAX_PROPERTIES = 64  # thousands in each message would take the event loop


class Version(IntEnum):
    """The protocol level in CONNECT."""

    V311 = 4
    V5 = 5


class Property(IntEnum):
    """Identifiers of properties, section 2.2.2.2."""

    MESSAGE_EXPIRY_S = 0x02
    CONTENT_TYPE = 0x03
    RESPONSE_TOPIC = 0x08
    CORRELATION = 0x09
    SESSION_EXPIRY_S = 0x11
    SERVER_KEEP_ALIVE_S = 0x13
    REASON_STRING = 0x1F
    RECEIVE_MAXIMUM = 0x21
    MAXIMUM_QOS = 0x24
    RETAIN_AVAILABLE = 0x25
    MAXIMUM_PACKET_BYTES = 0x27


PropertyValue = int | str | bytes
Properties = Mapping[int, PropertyValue]

_BYTES_OF_NUMBER = {
    **dict.fromkeys((0x01, 0x17, 0x19, 0x24, 0x25, 0x28, 0x29, 0x2A), 1),
    **dict.fromkeys((0x13, 0x21, 0x22, 0x23), 2),
    **dict.fromkeys((0x02, 0x11, 0x18, 0x27), 4),
}
_TEXTS = frozenset((0x03, 0x08, 0x12, 0x15, 0x1A, 0x1C, 0x1F))
_BINARIES = frozenset((0x09, 0x16))
_VARIABLE_NUMBER, _USER_PROPERTY = 0x0B, 0x26

PINGREQ = b"\xc0\x00"
DISCONNECT = b"\xe0\x00"


class PacketError(ValueError):
    """Bytes that no broker may send."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message, received or to be left behind as a will.

    Attributes:
        number: packet identifier; 0 at quality of service 0.
        payload: shorter than ``n_bytes`` where it was too long for the receiver.
        properties: of MQTT 5.
    """

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    number: int = 0
    properties: Properties = field(default_factory=dict)
    n_bytes: int = 0


@dataclass(frozen=True, slots=True)
class Connected:
    """CONNACK: the answer to CONNECT."""

    code: int
    session_present: bool
    properties: Properties


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """PUBACK, SUBACK or UNSUBACK: the answer to the packet with this number."""

    number: int
    codes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Pong:
    """PINGRESP: the broker is alive."""


@dataclass(frozen=True, slots=True)
class Disconnected:
    """DISCONNECT: the broker ends the connection."""

    code: int
    properties: Properties


Packet = Message | Connected | Acknowledged | Pong | Disconnected


# -- written --------------------------------------------------------------------------


def connect_packet(
    identifier: str,
    version: Version,
    keep_alive_s: int,
    *,
    clean_start: bool = True,
    username: str | None = None,
    password: str | None = None,
    will: Message | None = None,
    properties: Properties | None = None,
) -> bytes:
    """Encode CONNECT (section 3.1); ``properties`` are for MQTT 5 only."""
    flags = clean_start << 1
    payload = _text(identifier)
    if will is not None:
        flags |= 0x04 | will.qos << 3 | will.retain << 5
        payload += packed_properties(will.properties) if version is Version.V5 else b""
        payload += _text(will.topic) + _binary(will.payload)
    if username is not None:
        flags |= 0x80
        payload += _text(username)
    if password is not None:
        flags |= 0x40
        payload += _text(password)
    head = _text("MQTT") + bytes((version, flags)) + keep_alive_s.to_bytes(2)
    if version is Version.V5:
        head += packed_properties(properties or {})
    return _packet(0x10, head + payload)


def publish_packet(
    topic: str,
    payload: bytes,
    *,
    qos: int = 0,
    retain: bool = False,
    number: int = 0,
    properties: bytes = b"",
) -> bytes:
    """Encode PUBLISH (section 3.3).

    The number is from 1 to 65535 at quality of service 1. Properties are packed ones,
    and empty in MQTT 3.1.1.

    Raises:
        ValueError: nothing can be published on this topic, or it is too long.
    """
    name = topic.encode()
    if not 0 < len(name) < 1 << 16 or b"#" in name or b"+" in name or b"\0" in name:
        raise ValueError("is no topic that can be published on")
    head = len(name).to_bytes(2) + name
    if qos:
        head += number.to_bytes(2)
    return _packet(0x30 | qos << 1 | retain, head + properties, payload)


def acknowledgement_packet(number: int) -> bytes:
    """Encode PUBACK with success (section 3.4)."""
    return b"\x40\x02" + number.to_bytes(2)


def subscribe_packet(
    filters: Sequence[tuple[str, int]], number: int, version: Version
) -> bytes:
    """Encode SUBSCRIBE (section 3.8): topic filters with the largest qos for each."""
    head = number.to_bytes(2) + (b"\0" if version is Version.V5 else b"")
    entries = (_text(topic) + bytes((qos,)) for topic, qos in filters)
    return _packet(0x82, head + b"".join(entries))


def unsubscribe_packet(filters: Sequence[str], number: int, version: Version) -> bytes:
    """Encode UNSUBSCRIBE (section 3.10)."""
    head = number.to_bytes(2) + (b"\0" if version is Version.V5 else b"")
    return _packet(0xA2, head + b"".join(map(_text, filters)))


def packed_properties(properties: Properties) -> bytes:
    """Encode properties of MQTT 5 with their length before them (section 2.2.2)."""
    packed = b""
    for identifier, value in properties.items():
        packed += bytes((identifier,))
        if isinstance(value, int):
            packed += value.to_bytes(_BYTES_OF_NUMBER[identifier])
        else:
            packed += _text(value) if isinstance(value, str) else _binary(value)
    return _variable_number(len(packed)) + packed


def _packet(first: int, head: bytes, payload: bytes = b"") -> bytes:
    length = len(head) + len(payload)
    if length > MAX_LENGTH:
        raise ValueError(f"is a message of {length} bytes; MQTT has {MAX_LENGTH}")
    return bytes((first,)) + _variable_number(length) + head + payload


def _variable_number(value: int) -> bytes:
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def _binary(value: bytes) -> bytes:
    return len(value).to_bytes(2) + value


def _text(value: str) -> bytes:
    return _binary(value.encode())


# -- read -----------------------------------------------------------------------------


class PacketDecoder:
    """Decodes packets from the bytes of a broker, however they are cut.

    Only the first ``max_payload_bytes`` of a payload are kept, so that memory is
    bounded and the broker gets its acknowledgement.
    """

    def __init__(self, version: Version, max_payload_bytes: int) -> None:
        self._version = version
        self._max_payload_bytes = max_payload_bytes
        self._max_body_bytes = max_payload_bytes + HEAD_BYTES
        self._unread = bytearray()
        self._waiting: tuple[int, bytes, int] | None = None  # first, body, length
        self._n_to_skip = 0

    def feed(self, data: bytes | memoryview) -> None:
        """Append bytes, in the order of arrival."""
        if self._n_to_skip:
            n_skipped = min(self._n_to_skip, len(data))
            self._n_to_skip -= n_skipped
            data = data[n_skipped:]
        self._unread += data

    def packets(self) -> Iterator[Packet]:
        """Yield complete packets, each removed as it is yielded.

        Raises:
            PacketError: no broker sends this; nothing after it can be read.
        """
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet | None:
        if self._waiting is None:
            self._take_packet()
        if self._waiting is None or self._n_to_skip:
            return None
        (first, body, length), self._waiting = self._waiting, None
        return self._decoded(first, body, length)

    def _take_packet(self) -> None:
        """Take the next packet, as far as it is kept, from the unread bytes."""
        unread = self._unread
        if len(unread) < 2:
            return
        length, begin = unread[1] & 0x7F, 2
        while unread[begin - 1] & 0x80:
            if begin > 4:
                raise PacketError("a packet's length has more than four bytes")
            if len(unread) == begin:
                return
            length |= (unread[begin] & 0x7F) << 7 * (begin - 1)
            begin += 1
        n_kept = min(length, self._max_body_bytes)
        if len(unread) < begin + n_kept:
            return
        self._waiting = unread[0], bytes(unread[begin : begin + n_kept]), length
        n_here = min(len(unread), begin + length)
        del unread[:n_here]
        self._n_to_skip = begin + length - n_here

    def _decoded(self, first: int, body: bytes, length: int) -> Packet:
        packet: Packet
        try:
            match first >> 4:
                case 2:
                    packet = Connected(
                        body[1], bool(body[0] & 1), self._properties(body, 2)
                    )
                case 3:
                    packet = self._message(first, body, length)
                case 4:
                    packet = Acknowledged(_number(body, 0), (*body[2:3],) or (0,))
                case 9 | 11:
                    packet = Acknowledged(_number(body, 0), self._codes(body))
                case 13:
                    packet = Pong()
                case 14:
                    code = body[0] if body else 0
                    packet = Disconnected(code, self._properties(body, 1))
                case other:
                    raise IndexError(f"no broker sends type {other}")
        except (IndexError, UnicodeDecodeError) as error:
            raise PacketError(
                f"a packet that begins with {first:#04x} is malformed: {error}"
            ) from error
        return packet

    def _message(self, first: int, body: bytes, length: int) -> Message:
        qos, offset = first >> 1 & 3, 2 + _number(body, 0)
        if qos > 1:
            raise PacketError(f"a message with quality of service {qos}")
        topic, number = _text_at(body, 0), 0
        if not topic:
            raise PacketError("a message without a topic; aliases were not offered")
        if qos:
            number, offset = _number(body, offset), offset + 2
        properties: Properties = {}
        if self._version is Version.V5:
            try:
                properties, offset = _properties_at(body, offset)
            except IndexError:
                if len(body) == length:
                    raise
                # They are longer than what is kept: it cannot be used, but answered.
                offset = len(body)
        payload = body[offset : offset + self._max_payload_bytes]
        return Message(
            topic, payload, qos, bool(first & 1), number, properties, length - offset
        )

    def _codes(self, body: bytes) -> tuple[int, ...]:
        offset = _properties_at(body, 2)[1] if self._version is Version.V5 else 2
        return tuple(body[offset:])

    def _properties(self, body: bytes, offset: int) -> Properties:
        is_there = self._version is Version.V5 and len(body) > offset
        return _properties_at(body, offset)[0] if is_there else {}


def _number(body: bytes, offset: int) -> int:
    if len(body) < offset + 2:
        raise IndexError("it is too short")
    return int.from_bytes(body[offset : offset + 2])


def _binary_at(body: bytes, offset: int) -> bytes:
    end = offset + 2 + _number(body, offset)
    if len(body) < end:
        raise IndexError("it is too short")
    return body[offset + 2 : end]


def _text_at(body: bytes, offset: int) -> str:
    return _binary_at(body, offset).decode()


def _variable_number_at(body: bytes, offset: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = body[offset]
        value |= (byte & 0x7F) << shift
        offset, shift = offset + 1, shift + 7
        if not byte & 0x80:
            return value, offset
        if shift > 21:
            raise IndexError("a length has more than four bytes")


def _properties_at(body: bytes, offset: int) -> tuple[Properties, int]:
    """Return properties by identifier, without those for users, and their end.

    Only the first `MAX_PROPERTIES` are read.
    """
    length, offset = _variable_number_at(body, offset)
    end = offset + length
    if len(body) < end:
        raise IndexError("properties are longer than the packet, or than is kept")
    values: dict[int, PropertyValue] = {}
    for _ in range(MAX_PROPERTIES):
        if offset >= end:
            break
        identifier, offset = body[offset], offset + 1
        if n_bytes := _BYTES_OF_NUMBER.get(identifier):
            values[identifier] = int.from_bytes(body[offset : offset + n_bytes])
            offset += n_bytes
        elif identifier in _TEXTS:
            values[identifier] = _text_at(body, offset)
            offset += 2 + _number(body, offset)
        elif identifier in _BINARIES:
            values[identifier] = _binary_at(body, offset)
            offset += 2 + _number(body, offset)
        elif identifier == _VARIABLE_NUMBER:
            values[identifier], offset = _variable_number_at(body, offset)
        elif identifier == _USER_PROPERTY:
            offset += 2 + _number(body, offset)
            offset += 2 + _number(body, offset)
        else:
            raise IndexError(f"property {identifier:#04x} is unknown")
    return values, end
