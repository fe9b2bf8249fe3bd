"""Lines to all TCP clients."""

import asyncio
import fcntl
import struct
import termios
from typing import Self

from traverse.client.gateways.outlets import WRITE_S, Outlet, Report
from traverse.plurals import counted

MAX_RECEIVERS = 16
LOOK_S = 0.002


class TcpOutlet(Outlet):
    """A server that sends lines to all who are connected, and keeps them for one.

    A line is sent when a receiver's computer has confirmed it. A receiver that takes
    nothing for `WRITE_S` is disconnected: the others do not wait for it for ever.

    Args:
        host: to listen on.
        port: to listen on; 0: any that is free.
        report: called with what happens.

    Attributes:
        port: that is listened on.
    """

    promise = (
        "a line has arrived at the receiver's computer; what its program had not read "
        "when it ended is lost"
    )

    def __init__(self, host: str, port: int, report: Report) -> None:
        super().__init__(report)
        self._host, self.port = host, port
        self._receivers: dict[str, asyncio.StreamWriter] = {}
        self._connected = asyncio.Event()
        self._server: asyncio.Server | None = None

    @property
    def name(self) -> str:  # type: ignore[override]  # port assigned on listening
        """Where it listens."""
        return f"tcp {self._host}:{self.port}"

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(
            self._serve, self._host, self.port, limit=4096
        )
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    def close(self) -> None:
        """Stop listening, and disconnect all."""
        if self._server is not None:
            self._server.close()
        for writer in list(self._receivers.values()):
            writer.close()

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Keep a receiver until it disconnects; what it sends is ignored."""
        host, port, *_ = writer.get_extra_info("peername")
        name = f"{host}:{port}"
        if len(self._receivers) >= MAX_RECEIVERS:
            self._report(f"{name} is refused: {MAX_RECEIVERS} receivers are connected")
            writer.close()
            return
        # No data is buffered here for a receiver that may be gone.
        writer.transport.set_write_buffer_limits(high=0)
        self._receivers[name] = writer
        self._report(f"{name} is connected")
        self._connected.set()
        try:
            while await reader.read(4096):
                pass
        except OSError:
            pass
        finally:
            self._drop(name, "has disconnected")

    async def _send(self, data: bytes) -> None:
        while True:
            await self._connected.wait()
            names = list(self._receivers)
            if any(await asyncio.gather(*(self._offer(name, data) for name in names))):
                return

    async def _offer(self, name: str, data: bytes) -> bool:
        """Whether a receiver's computer has confirmed the lines."""
        writer = self._receivers.get(name)
        if writer is None:
            return False  # it has disconnected since it was listed
        try:
            async with asyncio.timeout(WRITE_S):
                writer.write(data)
                await writer.drain()
                while _unconfirmed(writer):  # noqa: ASYNC110 - no event reports it
                    await asyncio.sleep(LOOK_S)
        except TimeoutError:
            self._drop(name, f"has taken nothing for {WRITE_S:g} s: disconnected")
        except OSError as error:
            self._drop(name, f"has disconnected: {error.strerror or error}")
        return name in self._receivers

    def _drop(self, name: str, why: str) -> None:
        writer = self._receivers.pop(name, None)
        if writer is None:
            return
        writer.transport.abort()
        left = len(self._receivers)
        if not left:
            self._connected.clear()
        others = counted(left, "other receiver") if left else "points wait at the arm"
        self._report(f"{name} {why}; {others}")


def _unconfirmed(writer: asyncio.StreamWriter) -> int:
    """Sent bytes that the receiver's computer has not confirmed (tcp(7), SIOCOUTQ).

    Raises:
        ConnectionResetError: the connection has ended.
    """
    sock = writer.get_extra_info("socket")
    if writer.is_closing() or sock.fileno() < 0:
        raise ConnectionResetError("while it was sent to")
    answer = fcntl.ioctl(sock.fileno(), termios.TIOCOUTQ, bytes(4))
    return int(struct.unpack("i", answer)[0])
