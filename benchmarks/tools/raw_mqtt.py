"""MQTT 3.1.1 on a bare socket: as quick as a client can be."""

import socket
import struct
import time
from collections.abc import Iterator

CONNECT, PUBLISH, SUBSCRIBE, SUBACK = 1, 3, 8, 9
AT_LEAST_ONCE = 2  # quality of service 1, as in the first byte
READ_BYTES = 65_536


def packet(kind: int, flags: int, content: bytes) -> bytes:
    """A control packet: its first byte, the length in sevens of bits, the content."""
    length, head = len(content), bytearray([kind << 4 | flags])
    while True:
        length, low = divmod(length, 128)
        head.append(low | (0x80 if length else 0))
        if not length:
            return bytes(head) + content


def text(value: str) -> bytes:
    """A string with its length in front."""
    return struct.pack(">H", len(value)) + value.encode()


class RawClient:
    """A connection to a broker on loopback, without Nagle's delay."""

    def __init__(self, port: int, name: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""
        begin = text("MQTT") + b"\x04\x02" + struct.pack(">H", 0) + text(name)
        self._socket.sendall(packet(CONNECT, 0, begin))
        next(self._packets())

    def close(self) -> None:
        self._socket.close()

    def subscribe(self, topic: str) -> None:
        content = struct.pack(">H", 1) + text(topic) + b"\x01"
        self._socket.sendall(packet(SUBSCRIBE, 2, content))
        for kind, _ in self._packets():
            if kind >> 4 == SUBACK:
                return

    def publish(self, topic: str, number: int, payload: bytes) -> None:
        """Send at quality of service 1, without waiting for the answer."""
        content = text(topic) + struct.pack(">H", number % 65_535 + 1) + payload
        self._socket.sendall(packet(PUBLISH, AT_LEAST_ONCE, content))

    def payloads(self, silence_ns: int | None = None) -> Iterator[tuple[int, bytes]]:
        """Payloads of the subscribed topics, with the time [ns] after the read.

        Ends when the broker has sent nothing for so long, where that is given.
        """
        self._socket.settimeout(silence_ns and silence_ns * 1e-9)
        for kind, content in self._packets():
            now_ns = time.monotonic_ns()
            if kind >> 4 == PUBLISH:
                start = 2 + struct.unpack_from(">H", content)[0]
                if kind & 6:  # it has a number, which is acknowledged
                    self._socket.sendall(b"\x40\x02" + content[start : start + 2])
                    start += 2
                yield now_ns, content[start:]

    def _packets(self) -> Iterator[tuple[int, bytes]]:
        while True:
            data = self._rest
            offset, length, shift = 1, 0, 0
            while offset < len(data):
                length |= (data[offset] & 127) << shift
                shift += 7
                offset += 1
                if data[offset - 1] < 128:
                    break
            if offset > 1 and data[offset - 1] < 128 and len(data) >= offset + length:
                self._rest = data[offset + length :]
                yield data[0], data[offset : offset + length]
                continue
            try:
                received = self._socket.recv(READ_BYTES)
            except TimeoutError:
                return
            if not received:
                raise ConnectionError("the broker has closed the connection")
            self._rest += received
