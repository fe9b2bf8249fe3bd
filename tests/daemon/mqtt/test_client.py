"""What aiomqtt's client does not do for us by itself."""

import asyncio
import contextlib
import socket
from itertools import pairwise

import aiomqtt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drivers.taken import until
from traverse.daemon.mqtt.client import (
    BrokerClient,
    publish_packet,
    publish_properties,
)
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage

ACCEPTED = bytes((0x20, 3, 0, 0, 0))  # MQTT 5: CONNACK, success, no properties
POSE = b"\x30\x0a" + b"\x00\x04live" + b"\x00" + b"abc"  # PUBLISH, QoS 0
POINT = OutgoingMessage("p", b"abc", qos=1)
MSGPACK = bytes.fromhex("16 03 00 13") + b"application/msgpack"


@contextlib.asynccontextmanager
async def connected(**handlers):
    """A client, and its broker's side of the connection."""
    loop = asyncio.get_running_loop()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        port = listener.getsockname()[1]
        version = aiomqtt.ProtocolVersion.V5
        client = BrokerClient("127.0.0.1", port, protocol=version, **handlers)

        async def accept():
            line, _ = await loop.sock_accept(listener)
            line.setblocking(False)
            assert (await loop.sock_recv(line, 1000))[0] == 0x10  # CONNECT
            await loop.sock_sendall(line, ACCEPTED)
            return line

        taking = asyncio.create_task(accept())
        async with contextlib.AsyncExitStack() as stack:
            await stack.enter_async_context(client)
            yield client, stack.enter_context(await taking)


async def test_messages_that_are_sent_together_leave_together():
    async with connected() as (client, line):
        client.send(OutgoingMessage("live", b"abc"), b"\0")
        assert line.recv(1000) == POSE  # at once, where it is alone
        with client.corked():
            client.send(OutgoingMessage("live", b"abc"), b"\0")
            client.send(OutgoingMessage("live", b"abc"), b"\0")
            with pytest.raises(BlockingIOError):
                line.recv(1000)
        assert line.recv(1000) == POSE + POSE


async def test_what_the_socket_does_not_take_follows_whole_and_in_order():
    told = []
    async with connected(writable=lambda: told.append(True)) as (client, line):
        messages = [OutgoingMessage("live", bytes((i,)) * 500_000) for i in range(30)]
        with client.corked():
            for message in messages:
                client.send(message, b"\0")
        assert client.is_congested
        wanted = b"".join(publish_packet(message, 0, b"\0") for message in messages)
        received = b""
        while len(received) < len(wanted):
            received += await asyncio.get_running_loop().sock_recv(line, 1 << 20)
        assert received == wanted
        await until(lambda: bool(told), "room to be reported")
        assert not client.is_congested


async def test_a_connection_that_is_gone_is_told_by_sending_and_not_by_holding_back():
    client = BrokerClient("nowhere")
    with pytest.raises(aiomqtt.MqttError), client.corked():
        client.send(OutgoingMessage("live", b"abc"), b"\0")


def test_packets_by_hand():
    assert publish_packet(OutgoingMessage("live", b"abc"), 7, b"\0") == POSE
    assert publish_packet(POINT, 258, b"\0") == b"\x32\x09\x00\x01p\x01\x02\x00abc"
    assert publish_packet(POINT, 258, b"") == b"\x32\x08\x00\x01p\x01\x02abc"  # 3.1.1
    kept = OutgoingMessage("s", bytes(123), qos=1, retain=True)
    assert publish_packet(kept, 1, b"\0")[:3] == b"\x33\x81\x01"  # 129 bytes


@pytest.mark.parametrize("topic", ["", "a/#", "a/+/b", "a" * 65_536, "\ud800"])
def test_topics_that_nothing_can_be_published_on_are_refused(topic):
    with pytest.raises(ValueError, match=r"topic|surrogates"):
        publish_packet(OutgoingMessage(topic, b""), 1, b"")


def test_properties_by_hand():
    assert publish_properties("msgpack") == MSGPACK
    answer = publish_properties("msgpack", b"\x01\x02\x03")
    assert answer == b"\x1c" + MSGPACK[1:] + b"\x09\x00\x03\x01\x02\x03"


PINGRESP = b"\xd0\x00"
ANSWERS = {  # PUBACK of MQTT 5, section 3.4
    b"\x40\x02\x00\x01": (1, None),
    b"\x40\x03\x00\x02\x10": (2, None),  # no matching subscribers
    b"\x40\x04\x01\x03\x87\x00": (259, "Not authorized"),
    b"\x40\x09\x00\x04\x97\x05\x1f\x00\x02no": (4, "Quota exceeded"),
    b"\x40\x03\x00\x05\xf3": (5, "reason code 0xf3"),
}


@given(
    order=st.lists(st.sampled_from([*ANSWERS, PINGRESP, POSE]), max_size=12),
    cuts=st.lists(st.integers(0, 120), max_size=5),
)
def test_answers_are_read_however_they_arrive(order, cuts):
    """Beside packets for paho (PINGRESP, a message), and cut anywhere."""
    answered, received = [], []

    async def run():
        async with connected(
            acknowledged=lambda *answer: answered.append(answer),
            received=lambda message: received.append(message.payload),
        ) as (client, line):
            data = b"".join(order)
            for begin, end in pairwise([0, *sorted(cuts), len(data)]):
                line.send(data[begin:end])
                for _ in range(3):
                    await asyncio.sleep(0)
            n = len(order) - order.count(PINGRESP)
            await until(lambda: len(answered) + len(received) == n, "all that was sent")
            client.send(POINT, b"\0")  # it is still connected

    asyncio.run(run())
    assert answered == [ANSWERS[packet] for packet in order if packet in ANSWERS]
    assert received == [b"abc"] * order.count(POSE)
