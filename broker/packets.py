"""Packets of MQTT 3.1.1 and 5: their values, and the bytes that a client writes.

Quality of service 2, topic aliases and extended authentication are not supported: a
client that announces none of them is sent none. Sections are those of the OASIS
standard "MQTT Version 5.0". `traverse.broker.decoder` reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

MAX_LENGTH = 268_435_455  # of a packet, section 1.5.5


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

BYTES_OF_NUMBER = {
    **dict.fromkeys((0x01, 0x17, 0x19, 0x24, 0x25, 0x28, 0x29, 0x2A), 1),
    **dict.fromkeys((0x13, 0x21, 0x22, 0x23), 2),
    **dict.fromkeys((0x02, 0x11, 0x18, 0x27), 4),
}

PINGREQ = b"\xc0\x00"
DISCONNECT = b"\xe0\x00"


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
            packed += value.to_bytes(BYTES_OF_NUMBER[identifier])
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
