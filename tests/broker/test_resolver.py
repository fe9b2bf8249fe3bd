"""Lookups of names, with a resolver that does not answer."""

import asyncio
import socket
import threading

import pytest

from traverse.broker.resolver import addresses_of
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

    def resolver(*place, **options):
        asked.append(place)
        answers.wait(20.0)
        return [(0, 0, 0, "", ("192.0.2.7", 1883))]

    monkeypatch.setattr(socket, "getaddrinfo", resolver)
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
