"""A network that fails on command: a TCP proxy between a program and its server."""

import asyncio
import contextlib
from typing import Self

READ_BYTES = 65_536


class Network:
    """Passes bytes between clients of `port` and a server on loopback.

    Args:
        port: of this side; 0 takes a free one.

    Attributes:
        cuts: how often connections were cut.
    """

    def __init__(self, server_port: int, port: int = 0) -> None:
        self._server_port = server_port
        self.port = port
        self.cuts = 0
        self._server: asyncio.Server | None = None
        self._running: set[asyncio.Task[None]] = set()
        self._is_open = asyncio.Event()
        self._is_open.set()
        self._is_closed = False

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = int(self._server.sockets[0].getsockname()[1])
        return self

    async def __aexit__(self, *raised: object) -> None:
        if self._server is not None:
            self._server.close()
        await self.cut()

    async def cut(self) -> None:
        """End all connections; new ones are accepted."""
        self.cuts += 1
        for task in (tasks := list(self._running)):
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def refuse(self) -> None:
        """Close every new connection at once, until `pass_on`."""
        self._is_closed = True

    def swallow(self) -> None:
        """Let all bytes wait, as a pulled plug does."""
        self._is_open.clear()

    def pass_on(self) -> None:
        self._is_closed = False
        self._is_open.set()

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        task = asyncio.current_task()
        if task is not None:
            self._running.add(task)
            task.add_done_callback(self._running.discard)
        try:
            if not self._is_closed:
                await self._join(reader, writer)
        except (OSError, asyncio.CancelledError):
            pass  # that is what this is for
        finally:
            writer.transport.abort()

    async def _join(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        beyond, onward = await asyncio.open_connection("127.0.0.1", self._server_port)
        ways = [
            asyncio.ensure_future(self._pass(reader, onward)),
            asyncio.ensure_future(self._pass(beyond, writer)),
        ]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            onward.transport.abort()

    async def _pass(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(READ_BYTES):
                await self._is_open.wait()
                writer.write(data)
                await writer.drain()
