import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from typing import Any

import pytest
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from traverse.client.page import connections
from traverse.client.page.connections import MOST_OF_ONE, BoundedHttpProtocol
from traverse.testing.waiting import until

HOST = "127.0.0.1"
REQUEST = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


async def served(scope: Scope, receive: Receive, send: Send) -> None:
    while (await receive()).get("more_body"):
        pass
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"page"})


@contextlib.asynccontextmanager
async def serving(app: ASGIApp = served) -> AsyncIterator[int]:
    """A server of uvicorn, like the page's; gives its port."""
    BoundedHttpProtocol.open_transports.clear()
    with socket.create_server((HOST, 0)) as listener:
        config = uvicorn.Config(
            app, http=BoundedHttpProtocol, lifespan="off", log_config=None
        )
        server = uvicorn.Server(config)
        task = asyncio.create_task(server.serve([listener]))
        await until(lambda: server.started)
        yield listener.getsockname()[1]
        server.should_exit = True
        await task


async def answer(port: int) -> bytes:
    reader, writer = await asyncio.open_connection(HOST, port)
    writer.write(REQUEST)
    line = await reader.readline()
    writer.close()
    await writer.wait_closed()
    return line


async def test_one_address_holds_so_many_and_no_more() -> None:
    async with serving() as port:
        held = [await asyncio.open_connection(HOST, port) for _ in range(MOST_OF_ONE)]
        reader, writer = await asyncio.open_connection(HOST, port)
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""  # closed at once
        writer.close()
        held[0][1].write(REQUEST)
        assert await held[0][0].readline() == b"HTTP/1.1 200 OK\r\n"
        for _, other in held:
            other.close()
        await until(lambda: not BoundedHttpProtocol.open_transports or _all_closing())
        assert await answer(port) == b"HTTP/1.1 200 OK\r\n"


def _all_closing() -> bool:
    transports = BoundedHttpProtocol.open_transports.values()
    return all(
        transport.is_closing() for several in transports for transport in several
    )


async def test_a_connection_that_says_nothing_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 0.05)
    async with serving() as port:
        for request, answered in (
            (b"", b""),
            (b"GET / HTTP/1.1\r\nHost: ", b""),
            (b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\nab", b""),
            (REQUEST + b"GET / HT", b"HTTP/1.1 200 OK\r\n"),
        ):
            reader, writer = await asyncio.open_connection(HOST, port)
            writer.write(request)
            async with asyncio.timeout(5):
                with contextlib.suppress(ConnectionError):
                    assert await reader.readline() == answered
                    await reader.read()
            writer.close()


async def test_an_answer_may_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 0.01)
    looked: list[object] = []
    look = BoundedHttpProtocol._close_if_silent

    def counted(self: BoundedHttpProtocol, *arguments: Any) -> None:
        looked.append(arguments)
        look(self, *arguments)

    async def slow(scope: Scope, receive: Receive, send: Send) -> None:
        await until(lambda: len(looked) >= 4)
        await served(scope, receive, send)

    monkeypatch.setattr(BoundedHttpProtocol, "_close_if_silent", counted)
    async with serving(slow) as port:
        assert await answer(port) == b"HTTP/1.1 200 OK\r\n"
