"""Reports of a broker that cannot be used."""

import asyncio
import socket

import pytest

from tests.daemon.mqtt.connection_harness import Bench, address
from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.embedded_broker import BrokerStartError, embedded_broker

pytestmark = pytest.mark.needs("mosquitto")


async def test_a_broker_that_is_not_there_is_told(make_mosquitto):
    broker = make_mosquitto()
    broker.stop()
    assert await Bench(address(broker)).publisher.probe() == "nothing listens there"


async def test_a_host_that_does_not_exist_is_reported():
    bench = Bench(BrokerAddress("no-such-host.invalid", 1883))
    assert await bench.publisher.probe() == "no such host"


async def test_a_wrong_password_is_told(make_mosquitto, tmp_path):
    broker = make_mosquitto({"arm": "secret"})
    password = tmp_path / "password"
    password.write_text("guess\n")
    given = address(broker, username="arm", password_file=str(password))
    assert "refuses user 'arm'" in await Bench(given).publisher.probe()
    password.write_text("secret\n")
    assert await Bench(given).publisher.probe() is None


async def test_a_missing_password_file_is_reported(mosquitto, tmp_path):
    missing = tmp_path / "nowhere"
    given = address(mosquitto, username="arm", password_file=str(missing))
    assert str(missing) in await Bench(given).publisher.probe()


async def test_something_that_is_no_broker_is_reported():
    async def greet(reader, writer):
        writer.write(b"SSH-2.0-nothing\r\n")
        writer.close()

    server = await asyncio.start_server(greet, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with server:
        assert await Bench(BrokerAddress("127.0.0.1", port)).publisher.probe()


async def test_an_embedded_broker_without_a_free_port_says_so():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(BrokerStartError, match=str(port)):
            async with embedded_broker(port):
                pass
