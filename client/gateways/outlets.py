"""Destinations of lines: a growing file, a serial port, datagrams, TCP clients.

Each waits until the other side has taken a line, as far as its protocol says so, and
retries without limit: other lines stay with the arm.
"""

import asyncio
import errno
import fcntl
import os
import struct
import termios
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Self

from traverse.plurals import counted
from traverse.strict_toml.files import lock_alone

if TYPE_CHECKING:
    from serial import Serial


RETRY_S = 1.0
WRITE_S = 10.0  # a receiver that takes nothing for so long is reported
REFUSAL_S = 0.005  # after which a computer without a listener has usually said so

Report = Callable[[str], None]


def url_of(scheme: str, host: str, port: int) -> str:
    """Return the URL of a server; IPv6 addresses stand in brackets."""
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"


class NotTakenError(Exception):
    """A line must not be sent now, nor later; states why."""


class Outlet(ABC):
    """Sends lines; use with `async with`.

    Args:
        report: called with messages for people.

    Attributes:
        name: of the receiver, for people.
        promise: meaning of a sent line here, for people.
    """

    name: str
    promise: str

    def __init__(self, report: Report) -> None:
        self._report = report
        self._has_failed = False

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *failure: object) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Close it."""

    async def send(self, data: bytes) -> None:
        """Send whole lines; returns when they are taken.

        Raises:
            NotTakenError: they must not be sent.
        """
        while True:
            try:
                await self._send(data)
            except OSError as error:  # pyserial's errors are such, too
                if not self._has_failed:
                    self._has_failed = True
                    self._report(
                        f"{self.name}: {error.strerror or error}; tried again every "
                        f"{RETRY_S:g} s, points wait at the arm"
                    )
                await asyncio.sleep(RETRY_S)
            else:
                if self._has_failed:
                    self._has_failed = False
                    self._report(f"{self.name}: takes lines again")
                return

    @abstractmethod
    async def _send(self, data: bytes) -> None:
        """Send once; raises OSError on failure."""


class LockedOutlet(Outlet):
    """A destination for one program alone: mixed lines of two are of no use."""

    async def __aenter__(self) -> Self:
        """Open and lock it; one that is missing is opened when there is a line.

        Raises:
            OSError: another program uses it.
        """
        try:
            await asyncio.to_thread(self._opened)
        except OSError as error:
            if error.errno == errno.EBUSY:
                raise
        return self

    @abstractmethod
    def _opened(self) -> object:
        """Return the open stream, opened if it is not; for another thread.

        Raises:
            OSError: it cannot be opened; EBUSY: another program uses it.
        """


class FileOutlet(LockedOutlet):
    """Appends to a file, which may be moved away at any time."""

    promise = "a line is on the disk before the next point is requested"

    def __init__(self, path: Path, report: Report) -> None:
        super().__init__(report)
        self.name = str(path)
        self._path = path
        self._descriptor: int | None = None

    def close(self) -> None:
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    async def _send(self, data: bytes) -> None:
        await asyncio.to_thread(self._append, data)

    def _opened(self) -> int:
        if self._descriptor is not None:
            if self._is_in_place(self._descriptor):
                return self._descriptor
            self.close()
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
        self._descriptor = os.open(self._path, flags, 0o644)
        try:
            lock_alone(self._descriptor, self._path, "appends to it")
        except OSError:
            self.close()
            raise
        return self._descriptor

    def _is_in_place(self, descriptor: int) -> bool:
        """Return whether an open file is still the one of that name."""
        try:
            return os.path.samestat(os.fstat(descriptor), self._path.stat())
        except OSError:
            return False

    def _append(self, data: bytes) -> None:
        file = self._opened()
        size = os.fstat(file).st_size
        try:
            if os.write(file, data) != len(data):
                raise OSError("the disk took a part of a line only")
            os.fsync(file)
        except OSError:
            os.ftruncate(file, size)  # no line is there in part, or twice
            raise


class SerialOutlet(LockedOutlet):
    """Writes to a serial port, which is reopened after a loss.

    Args:
        port: path or name of the port.
    """

    promise = "a line has left this computer; the cable confirms nothing"

    def __init__(self, port: str, baud_rate: int, report: Report) -> None:
        super().__init__(report)
        self.name = port
        self._baud_rate = baud_rate
        self._serial: Serial | None = None

    def close(self) -> None:
        port, self._serial = self._serial, None
        if port is not None:
            port.close()

    async def _send(self, data: bytes) -> None:
        try:
            await asyncio.to_thread(self._write, data)
        except OSError:
            self.close()
            raise

    def _opened(self) -> "Serial":
        from serial import Serial  # noqa: PLC0415 - of an extra

        if self._serial is not None:
            return self._serial
        try:
            self._serial = Serial(
                self.name, self._baud_rate, write_timeout=WRITE_S, exclusive=True
            )
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise
            reason = "another program uses it"
            raise OSError(errno.EBUSY, reason, self.name) from error
        return self._serial

    def _write(self, data: bytes) -> None:
        port = self._opened()
        port.write(data)
        port.flush()


class UdpOutlet(Outlet, asyncio.DatagramProtocol):
    """Send a datagram a line.

    Args:
        report: called with each event.
    """

    promise = "a line was sent; UDP confirms nothing, and may lose it"

    def __init__(self, host: str, port: int, report: Report) -> None:
        super().__init__(report)
        self.name = f"udp {host}:{port}"
        self._where = (host, port)
        self._transport: asyncio.DatagramTransport | None = None
        self._error: OSError | None = None

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def error_received(self, exc: Exception) -> None:
        """Note that the receiver's computer refused an earlier datagram."""
        self._error = exc if isinstance(exc, OSError) else OSError(str(exc))

    async def _send(self, data: bytes) -> None:
        if self._transport is None:
            loop = asyncio.get_running_loop()
            self._transport, _ = await loop.create_datagram_endpoint(
                lambda: self, remote_addr=self._where
            )
        self._error = None
        for line in data.splitlines(keepends=True):
            self._transport.sendto(line)
        await asyncio.sleep(REFUSAL_S)
        if self._error is not None:
            raise self._error


MAX_RECEIVERS = 16
LOOK_S = 0.002


class TcpOutlet(Outlet):
    """A server that sends lines to all connected clients, and waits for one.

    A line is sent when a receiver's computer has confirmed it. A receiver that takes
    nothing for `WRITE_S` is disconnected, so that the others do not wait for it.

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
        return f"tcp {self._host}:{self.port}"

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(
            self._serve, self._host, self.port, limit=4096
        )
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
        for writer in list(self._receivers.values()):
            writer.close()

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Serve a receiver until it disconnects; its input is ignored."""
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
        """Send lines; return whether a receiver's computer has confirmed them."""
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
        remaining = (
            counted(left, "other receiver") if left else "points wait at the arm"
        )
        self._report(f"{name} {why}; {remaining}")


def _unconfirmed(writer: asyncio.StreamWriter) -> int:
    """Return sent bytes that are not confirmed (tcp(7), SIOCOUTQ).

    Raises:
        ConnectionResetError: the connection has ended.
    """
    sock = writer.get_extra_info("socket")
    if writer.is_closing() or sock.fileno() < 0:
        raise ConnectionResetError("while it was sent to")
    answer = fcntl.ioctl(sock.fileno(), termios.TIOCOUTQ, bytes(4))
    return int(struct.unpack("i", answer)[0])
