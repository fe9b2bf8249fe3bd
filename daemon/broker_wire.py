"""The socket of a connection to a broker: what goes with every message, ourselves.

paho takes a system call for each byte of a packet's head, and some objects and locks
for each message and its answer: 80 us of a processor for each point, which is more than
it takes to measure it. So messages are written here, as many as there are in one call,
and their answers read; everything else is still paho's: connecting, being alive,
commands.

paho reads what `BrokerWire` hands over to it, and gives its packets their turn between
ours, never within one.
"""

import ssl

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.enums import MQTTErrorCode

from protocol.mqtt_packets import PacketStream, answer_of

READ_BYTES = 16_384
WRITTEN_BYTES = 65_536  # more is not collected before it is written
FIRST_NUMBER = 0x8000  # paho counts what it asks itself from 1
LAST_NUMBER = 0xFFFF
NOT_NOW = (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


class BrokerWire:
    """Writes to and reads from the socket that paho has opened.

    Args:
        client: paho's, which nobody else lets read.

    Attributes:
        is_congested: bytes wait that the socket did not take.
    """

    def __init__(self, client: PahoClient) -> None:
        self._client = client
        self._packets = PacketStream()
        self._unread = bytearray()  # whole packets, for paho
        self._is_over = False
        self._error: OSError | None = None
        self._waiting = bytearray()
        self._is_cut = False  # within a packet of ours: nobody else may write
        self._number = LAST_NUMBER
        self.is_congested = False
        # There is no public way; if another paho called it otherwise, nothing that
        # the broker says would be heard, and no test of a connection would pass.
        client._sock_recv = self._hand_over  # type: ignore[method-assign]  # noqa: SLF001 - see above

    def next_number(self) -> int:
        """The number for the next message that is to be answered."""
        is_last = self._number >= LAST_NUMBER
        self._number = FIRST_NUMBER if is_last else self._number + 1
        return self._number

    @property
    def has_enough(self) -> bool:
        """So much has been put that it should be written before there is more."""
        return len(self._waiting) >= WRITTEN_BYTES

    def put(self, packet: bytes) -> None:
        """Have a packet written with the next call of `write`."""
        self._waiting += packet

    def write(self) -> None:
        """Write what waits, as far as the socket takes it now.

        Raises:
            aiomqtt.MqttError: there is no connection any more.
        """
        self.is_congested = True
        if self._is_cut and not self._write_own():
            return
        if self._client.want_write():
            result = self._client.loop_write()
            if result != MQTTErrorCode.MQTT_ERR_SUCCESS:
                raise aiomqtt.MqttCodeError(result, "could not write")
            if self._client.want_write():
                return
        if self._write_own():
            self.is_congested = False

    def read(self) -> list[tuple[int, int]]:
        """Take in what has come; gives the answers to our messages.

        Returns:
            Number and reason code of each.
        """
        answers: list[tuple[int, int]] = []
        sock = self._client.socket()
        while sock is not None and sock is self._client.socket():
            try:
                data = sock.recv(READ_BYTES)
            except NOT_NOW:
                break
            except OSError as error:
                self._error, data = error, b""
            answers += self._sorted(data)
            pending = getattr(sock, "pending", None)  # deciphered already
            if len(data) < READ_BYTES and not (pending and data and pending()):
                break
        return answers

    def _sorted(self, data: bytes) -> list[tuple[int, int]]:
        """Give paho its packets of some data, all at its end; and us the answers."""
        answers = []
        for packet in self._packets.feed(data):
            answer = answer_of(packet)
            if answer is not None and answer[0] >= FIRST_NUMBER:
                answers.append(answer)
            else:
                self._unread += packet
        if not data:
            self._is_over = True
            self._unread += self._packets.begun
        while self._unread and self._client.socket() is not None:
            self._client.loop_read()
        if self._is_over and self._client.socket() is not None:
            self._client.loop_read()
        return answers

    def _hand_over(self, bufsize: int) -> bytes:
        """What paho reads instead of the socket."""
        if not self._unread:
            if self._error is not None:
                raise self._error
            if self._is_over:
                return b""
            raise BlockingIOError
        taken = bytes(self._unread[:bufsize])
        del self._unread[:bufsize]
        return taken

    def _write_own(self) -> bool:
        """Write our packets; False where some are left."""
        while self._waiting:
            sock = self._client.socket()
            if sock is None:
                code = MQTTErrorCode.MQTT_ERR_NO_CONN
                raise aiomqtt.MqttCodeError(code, "could not write")
            try:
                written = sock.send(self._waiting)
            except NOT_NOW:
                # TLS wants to be given the same bytes again, so they come first.
                self._is_cut = True
                return False
            except OSError as error:
                raise aiomqtt.MqttError(f"could not write: {error}") from error
            del self._waiting[:written]
        self._is_cut = False
        return True
