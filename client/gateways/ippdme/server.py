"""An arm behind a TCP port, for one client of I++ DME at a time."""

import asyncio
import socket
from collections.abc import AsyncIterable, Awaitable, Callable
from contextlib import suppress
from typing import TypeVar

from traverse.client.arm import Arm
from traverse.client.cancel_tasks import cancel_tasks, run_together
from traverse.client.errors import ClientError, CommandRefused
from traverse.client.gateways.ippdme.grammar import (
    MAX_LINE,
    IppError,
    LineBuffer,
    error_line,
)
from traverse.client.gateways.ippdme.options import Options
from traverse.client.gateways.ippdme.session import Session
from traverse.client.gateways.outlets import Report
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Event, Live, Point
from traverse.protocol.messages.later_doubt import LaterDoubt

LOOK_S = 0.2  # how often the arm's state is looked at
MAX_WAITING = 1 << 20  # bytes that a client may leave unread
KEEPALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}
"""A client that does not answer for 25 s is disconnected."""

T = TypeVar("T")


class IppServer:
    """Serves an arm.

    Args:
        report: called with messages for people.

    Attributes:
        port: that is listened on.
    """

    def __init__(
        self,
        arm: Arm,
        host: str,
        port: int,
        report: Report,
        options: Options,
    ) -> None:
        self._arm, self._host, self.port = arm, host, port
        self._report = report
        self._writer: asyncio.StreamWriter | None = None
        self._peer = ""
        self._changes: set[asyncio.Task[None]] = set()
        self._session = Session(options, self._send, report, self._change_probe)

    @property
    def address(self) -> str:
        return f"tcp {self._host}:{self.port}"

    async def serve(self, on_ready: Callable[[], None]) -> None:
        """Serve until cancelled; raises OSError if the port is unavailable."""
        server = await asyncio.start_server(self._serve, self._host, self.port)
        self.port = server.sockets[0].getsockname()[1]
        on_ready()
        try:
            await run_together(
                _each(self._arm.points_and_losses(), self._take),
                _each(self._arm.live(), self._take_live),
                _each(self._arm.events(), self._take_event),
                _each(self._arm.doubts(), self._take_doubt),
                self._look_on(),
            )
        finally:
            server.close()
            self._session.disconnected()
            if self._writer is not None:
                writer, self._writer = self._writer, None
                writer.transport.abort()  # it may not read what waits for it
                with suppress(OSError):
                    await writer.wait_closed()
            await cancel_tasks(self._changes)

    async def _look_on(self) -> None:
        while True:
            await self._look()
            await asyncio.sleep(LOOK_S)

    async def _look(self) -> None:
        try:
            status = await self._arm.status()
        except TimeoutError:
            return  # no arm of this name has ever been at the broker
        self._session.take_status(status, self._arm.absence)

    async def _take(self, item: Point | Lost) -> None:
        await self._look()  # a change of the probe comes before its points
        if isinstance(item, Lost):
            self._session.take_loss(item)
        else:
            self._session.take_point(item)

    async def _take_live(self, live: Live) -> None:
        await self._look()
        self._session.take_live(live)

    async def _take_event(self, event: Event) -> None:
        if event.code == "button.pressed":
            self._session.press(event.source)

    async def _take_doubt(self, doubt: LaterDoubt) -> None:
        self._session.take_doubt(doubt)

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Serve one client; a second one is refused with the reason."""
        peer = "{}:{}".format(*writer.get_extra_info("peername"))
        if self._writer is not None:
            self._report(f"{peer} is refused: {self._peer} is connected")
            why = f"Connect: {self._peer} has this arm"
            writer.write(error_line("E0000", why, IppError(508)).encode() + b"\r\n")
            writer.close()
            return
        self._writer, self._peer = writer, peer
        _keep_alive(writer.get_extra_info("socket"))
        self._report(f"{peer} is connected")
        buffer, why = LineBuffer(), "has disconnected"
        try:
            while data := await reader.read(4096):
                for line in buffer.lines(data):
                    self._session.take_line(line)
                    if len(line) > MAX_LINE + 2:
                        why = "is disconnected: its line has no end"
                        return
                await writer.drain()
        except OSError as error:
            why = f"has disconnected: {error.strerror or error}"
        finally:
            if self._writer is writer:
                self._session.disconnected()
                self._drop(why)

    def _drop(self, why: str) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()
            self._report(f"{self._peer} {why}; its session is over")

    def _send(self, line: str) -> None:
        writer = self._writer
        if writer is None or writer.is_closing():
            return
        writer.write(line.encode() + b"\r\n")
        if writer.transport.get_write_buffer_size() > MAX_WAITING:
            self._report(f"{self._peer} does not read")
            writer.transport.abort()

    def _change_probe(self, name: str) -> None:
        task = asyncio.create_task(self._probe(name))
        self._changes.add(task)
        task.add_done_callback(self._changes.discard)

    async def _probe(self, name: str) -> None:
        try:
            self._session.tool_changed(await self._arm.probe(name))
        except ClientError as error:
            number = 1502 if isinstance(error, CommandRefused) else 503
            self._session.tool_refused(IppError(number, str(error)))


async def _each(feed: AsyncIterable[T], take: Callable[[T], Awaitable[None]]) -> None:
    async for item in feed:
        await take(item)


def _keep_alive(sock: socket.socket) -> None:
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEPALIVE.items():
        if hasattr(socket, name):
            sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
