"""Packets of MQTT as bytes: what publishes a message, and what answers it.

Only what a publisher needs at every message; MQTT 3.1.1 and 5 differ in the properties
alone, which 5 has and 3.1.1 has not (OASIS, MQTT 5.0, sections 2.1, 3.3 and 3.4).
"""

import struct
from functools import lru_cache

PUBLISH, PUBACK = 0x30, 0x40
AT_LEAST_ONCE = 2  # quality of service 1, as it stands in the first byte
MOST_BYTES = 268_435_455  # what four bytes of length can say
MOST_TEXT_BYTES = 65_535
LENGTH_BYTES = 4
FAILED = 0x80  # reason codes from here on say no


def publish_packet(
    topic: str,
    payload: bytes,
    *,
    number: int | None = None,
    retain: bool = False,
    properties: bytes = b"",
) -> bytes:
    """The packet that publishes a message.

    Args:
        topic: where to.
        payload: as it is.
        number: with which the broker is to answer (quality of service 1, 1 to 65535);
            None: it does not answer (quality of service 0).
        retain: the broker is to keep it for those who come later.
        properties: as MQTT 5 packs them, their length in front; nothing for 3.1.1.

    Raises:
        ValueError: nothing can be published on this topic, or so much at once.
    """
    head = _topic(topic)
    first, between = PUBLISH | retain, b""
    if number is not None:
        first, between = first | AT_LEAST_ONCE, number.to_bytes(2, "big")
    parts = (head, between, properties, payload)
    n_bytes = sum(map(len, parts))
    if n_bytes > MOST_BYTES:
        raise ValueError(f"{n_bytes} bytes in a packet, expected at most {MOST_BYTES}")
    return b"".join((bytes((first,)), length_bytes(n_bytes), *parts))


def length_bytes(length: int) -> bytes:
    """A length in sevens of bits, the lowest first."""
    found = bytearray()
    while True:
        length, low = length >> 7, length & 0x7F
        found.append(low | (0x80 if length else 0))
        if not length:
            return bytes(found)


def answer_of(packet: bytes) -> tuple[int, int] | None:
    """The number that a PUBACK answers and its reason code; None for other packets."""
    if packet[0] != PUBACK or len(packet) < 4 or packet[1] & 0x80:
        return None
    return int.from_bytes(packet[2:4], "big"), packet[4] if len(packet) > 4 else 0


class PacketStream:
    """Cuts a stream of bytes into whole packets."""

    def __init__(self) -> None:
        self._begun = bytearray()

    @property
    def begun(self) -> bytes:
        """Of a packet whose end is still to come."""
        return bytes(self._begun)

    def feed(self, data: bytes) -> list[bytes]:
        """The packets that are whole now; what is no packet comes as it is."""
        begun, packets, at = self._begun, [], 0
        begun += data
        while (end := _end(begun, at)) is not None and end <= len(begun):
            packets.append(bytes(begun[at:end]))
            at = end
        del begun[:at]
        return packets


def _end(data: bytearray, at: int) -> int | None:
    """Where the packet that begins at a place ends; None where that is not said yet."""
    length, shift = 0, 0
    for place in range(at + 1, len(data)):
        byte = data[place]
        length |= (byte & 0x7F) << shift
        if not byte & 0x80:
            return place + 1 + length
        shift += 7
        if shift == 7 * LENGTH_BYTES:
            return len(data)  # not MQTT: whoever takes it will say so
    return None


@lru_cache(maxsize=256)  # an arm has a dozen topics, and its answers some more
def _topic(topic: str) -> bytes:
    encoded = topic.encode()
    if not topic or "+" in topic or "#" in topic or "\0" in topic:
        raise ValueError(f"topic {topic!r}, expected one without wildcards")
    if len(encoded) > MOST_TEXT_BYTES:
        raise ValueError(
            f"a topic of {len(encoded)} bytes, expected at most {MOST_TEXT_BYTES}"
        )
    return struct.pack("!H", len(encoded)) + encoded
