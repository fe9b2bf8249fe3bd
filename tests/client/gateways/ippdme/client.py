"""A client of I++ DME for tests; it shares nothing with the server."""

import asyncio
from contextlib import suppress
from typing import Self

from tests.client.gateways.ippdme.transcripts import write
from tests.client.reading import PATIENCE_S


class IppClient:
    """A connection; use with `async with`. Writes its transcript at the end.

    Args:
        port: of the server on this computer.
        name: of the transcript.

    Attributes:
        commands, replies: sent and received.
    """

    def __init__(self, port: int, name: str) -> None:
        self._port, self._name, self._tag = port, name, 0
        self.commands: list[str] = []
        self.replies: list[str] = []

    async def __aenter__(self) -> Self:
        self._reader, self._writer = await asyncio.open_connection(
            "127.0.0.1", self._port
        )
        return self

    async def __aexit__(self, *failure: object) -> None:
        self._writer.close()
        with suppress(OSError):
            await self._writer.wait_closed()
        write(self._name, self.commands, self.replies)

    def send(self, method: str, *, fast: bool = False) -> str:
        self._tag += 1
        tag = f"E{self._tag:04d}" if fast else f"{self._tag:05d}"
        self.commands.append(f"{tag} {method}")
        self._writer.write(self.commands[-1].encode("ascii") + b"\r\n")
        return tag

    async def reply(self) -> str:
        async with asyncio.timeout(PATIENCE_S):
            line = await self._reader.readline()
        if line:
            assert line.endswith(b"\r\n")
            self.replies.append(line[:-2].decode("ascii"))
        return line[:-2].decode("ascii")

    async def until(self, start: str) -> str:
        """The next line that begins so; others are passed over."""
        while not (line := await self.reply()).startswith(start):
            assert line, f"{start}: the connection has ended"
        return line

    async def ask(self, method: str, *, fast: bool = False) -> list[str]:
        tag, lines = self.send(method, fast=fast), []
        while (line := await self.until(tag)) != f"{tag} %":
            if line != f"{tag} &":
                lines.append(line.split(" ", 2)[2])
        return lines
