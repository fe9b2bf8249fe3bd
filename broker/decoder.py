"""From the bytes of a broker to packets of MQTT 3.1.1 and 5."""

from collections.abc import Iterator

from traverse.broker.packets import (
    BYTES_OF_NUMBER,
    Acknowledged,
    Connected,
    Disconnected,
    Message,
    Packet,
    Pong,
    Properties,
    PropertyValue,
    Version,
)

HEAD_BYTES = 200_000  # topic and ordinary properties of a message that is cut
MAX_PROPERTIES = 64  # thousands in each message would take the event loop
_TEXTS = frozenset((0x03, 0x08, 0x12, 0x15, 0x1A, 0x1C, 0x1F))
_BINARIES = frozenset((0x09, 0x16))
_VARIABLE_NUMBER, _USER_PROPERTY = 0x0B, 0x26


class PacketError(ValueError):
    """Bytes that no broker may send."""


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
        if n_bytes := BYTES_OF_NUMBER.get(identifier):
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
