"""Lookups of names, and addresses, that do not answer."""

import asyncio
import socket
import threading

import pytest

from traverse.broker import resolver
from traverse.broker.resolver import addresses_of, connect_to_host
from traverse.testing.waiting import until


async def test_numbers_and_names_have_addresses():
    assert await addresses_of("127.0.0.1", 1883) == ["127.0.0.1"]
    assert set(await addresses_of("localhost", 1883)) <= {"127.0.0.1", "::1"}


@pytest.mark.parametrize("host", ["no-such-host.invalid", "x" * 70, "a..b"])
async def test_what_is_no_name_has_none(host):
    with pytest.raises(OSError, match=r"known|resolution|label|encod|address|refused"):
        await addresses_of(host, 1883)


async def test_a_lookup_that_hangs_is_left_behind_and_shared(monkeypatch):
    answers, asked = threading.Event(), []

    def look_up(*place, **options):
        asked.append(place)
        answers.wait(20.0)
        return [(0, 0, 0, "", ("192.0.2.7", 1883))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    try:
        for _ in range(3):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0):
                    await addresses_of("slow.example", 1883)
        waiting = asyncio.create_task(addresses_of("slow.example", 1883))
        await until(lambda: asked, "the question")
        assert asked == [("slow.example", 1883)]
        (thread,) = [t for t in threading.enumerate() if t.name == "resolver"]
        assert thread.daemon  # the program may end without it
    finally:
        answers.set()
    assert await waiting == ["192.0.2.7"]
    thread.join(20.0)


async def test_an_address_that_does_not_answer_leaves_time_for_the_next(monkeypatch):
    """As one of two networks, or of IPv6, that is not there."""
    monkeypatch.setattr(resolver, "PATIENCE_S", 0.05)
    silent, answering = socket.socket(), socket.create_server(("127.0.0.1", 0))
    port = answering.getsockname()[1]
    silent.bind(("127.0.0.2", port))
    silent.listen(0)
    callers = [socket.socket() for _ in range(2)]  # its queue is full
    for caller in callers:
        caller.setblocking(False)
        caller.connect_ex(silent.getsockname())
    addresses = [(0, 0, 0, "", (f"127.0.0.{n}", port)) for n in (2, 1)]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *place, **options: addresses)
    connected = asyncio.get_running_loop().create_future()

    class Line(asyncio.Protocol):
        def connection_made(self, transport):
            connected.set_result(transport)

    async with asyncio.timeout(5.0):
        await connect_to_host(Line, "two.example", port, None)
    transport = await connected
    assert transport.get_extra_info("peername") == ("127.0.0.1", port)
    transport.close()
    for line in (silent, answering, *callers):
        line.close()
