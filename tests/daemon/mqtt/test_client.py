"""What aiomqtt's client does not do for us by itself."""

import asyncio
import contextlib
import socket

import aiomqtt
import pytest

from traverse.daemon.mqtt.client import BrokerClient
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage

ACCEPTED = bytes((0x20, 3, 0, 0, 0))  # MQTT 5: CONNACK, success, no properties
POSE = b"\x30\x0a" + b"\x00\x04live" + b"\x00" + b"abc"  # PUBLISH, QoS 0


async def accepted(listener: socket.socket) -> socket.socket:
    """The broker's side of a connection that it has taken."""
    loop = asyncio.get_running_loop()
    line, _ = await loop.sock_accept(listener)
    line.setblocking(False)
    assert (await loop.sock_recv(line, 1000))[0] == 0x10  # CONNECT
    await loop.sock_sendall(line, ACCEPTED)
    return line


async def test_messages_that_are_sent_together_leave_together():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        client = BrokerClient(
            "127.0.0.1",
            listener.getsockname()[1],
            protocol=aiomqtt.ProtocolVersion.V5,
        )
        taking = asyncio.create_task(accepted(listener))
        async with contextlib.AsyncExitStack() as stack:
            await stack.enter_async_context(client)
            line = stack.enter_context(await taking)
            client.send(OutgoingMessage("live", b"abc"), None)
            assert line.recv(1000) == POSE  # at once, where it is alone
            with client.corked():
                client.send(OutgoingMessage("live", b"abc"), None)
                client.send(OutgoingMessage("live", b"abc"), None)
                with pytest.raises(BlockingIOError):
                    line.recv(1000)
            assert line.recv(1000) == POSE + POSE


async def test_a_connection_that_is_gone_is_told_by_sending_and_not_by_holding_back():
    client = BrokerClient("nowhere")
    with client.corked(), pytest.raises(aiomqtt.MqttError):
        client.send(OutgoingMessage("live", b"abc"), None)
