"""Our packets and paho's on one socket: each whole, each to whom it belongs."""

import socket

import aiomqtt
import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from daemon.broker_wire import FIRST_NUMBER, LAST_NUMBER, BrokerWire
from protocol.mqtt_packets import PacketStream, publish_packet

PING = bytes.fromhex("c0 00")


class Line:
    """A wire with paho at one end of a pair of sockets, the broker at the other."""

    def __init__(self) -> None:
        self.broker, ours = socket.socketpair()
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        for end in (self.broker, ours):
            end.setblocking(False)
        self.paho = Client(
            CallbackAPIVersion.VERSION2, protocol=MQTTProtocolVersion.MQTTv5
        )
        self.paho.on_socket_register_write = lambda *_: None
        self.paho._sock = ours
        self.wire = BrokerWire(self.paho)
        self.came = b""

    def close(self) -> None:
        self.broker.close()
        self.paho._sock_close()

    def hear(self) -> None:
        """Take what has come at the broker."""
        try:
            while data := self.broker.recv(1 << 20):
                self.came += data
        except BlockingIOError:
            pass


@pytest.fixture
def line():
    line = Line()
    yield line
    line.close()


def test_packets_of_both_are_whole_whatever_the_socket_takes(line):
    ours = [publish_packet("a", bytes([k]) * 9000, number=1 + k) for k in range(40)]
    for packet in ours:
        line.wire.put(packet)
    line.wire.write()
    assert line.wire.is_congested
    line.paho._send_pingreq()
    while line.wire.is_congested:
        line.hear()
        line.wire.write()
    line.hear()
    stream = PacketStream()
    assert stream.feed(line.came) == [*ours, PING]
    assert stream.begun == b""


def test_what_paho_has_begun_goes_on_before_ours(line):
    theirs = publish_packet("b", bytes(400_000), number=7)
    line.paho._packet_queue(0x30, theirs, 7, 1)
    line.wire.put(publish_packet("a", b"1"))
    line.wire.write()
    line.wire.put(publish_packet("a", b"2"))
    while line.wire.is_congested:
        line.hear()
        line.wire.write()
    line.hear()
    assert PacketStream().feed(line.came) == [
        theirs,
        publish_packet("a", b"1"),
        publish_packet("a", b"2"),
    ]


def test_answers_are_ours_and_the_rest_is_pahos(line):
    pings = []
    line.paho._handle_pingresp = lambda: pings.append(1) or 0
    line.broker.sendall(bytes.fromhex("40 02 80 01 d0 00 40 03 80 02 87 40 02 00 05"))
    assert line.wire.read() == [(0x8001, 0), (0x8002, 0x87)]
    assert pings == [1]
    assert line.wire.read() == []


def test_an_answer_in_pieces_is_one(line):
    for piece in ("40", "02 80", ""):
        line.broker.sendall(bytes.fromhex(piece))
        assert line.wire.read() == []
    line.broker.sendall(bytes.fromhex("01"))
    assert line.wire.read() == [(0x8001, 0)]


@pytest.mark.parametrize("before", ["", "d0", "40 02 80"])
def test_paho_hears_of_the_end(line, before):
    line.broker.sendall(bytes.fromhex(before))
    line.broker.close()
    line.wire.read()  # what came before the end
    line.wire.read()
    assert line.paho.socket() is None
    line.wire.put(publish_packet("a", b""))
    with pytest.raises(aiomqtt.MqttError):
        line.wire.write()


def test_what_is_no_mqtt_ends_the_connection(line):
    line.broker.sendall(b"\x20\xff\xff\xff\xff\xff no MQTT")
    line.wire.read()
    assert line.paho.socket() is None


def test_numbers_begin_again_and_are_never_pahos(line):
    numbers = [line.wire.next_number() for _ in range(2 * (1 << 15))]
    assert numbers[: 1 << 15] == list(range(FIRST_NUMBER, LAST_NUMBER + 1))
    assert numbers[1 << 15 :] == numbers[: 1 << 15]
