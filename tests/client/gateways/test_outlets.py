"""Lines through real sockets, a pty and files, whose receivers fail and return."""

import asyncio
import contextlib
import os
import pty
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from traverse.client.gateways import outlets
from traverse.client.gateways.outlets import (
    MAX_RECEIVERS,
    FileOutlet,
    Outlet,
    SerialOutlet,
    TcpOutlet,
    UdpOutlet,
)
from traverse.testing.waiting import until

PATIENCE_S = 30.0


@contextlib.asynccontextmanager
async def receiver(port: int) -> AsyncIterator[asyncio.StreamReader]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        yield reader
    finally:
        writer.close()


async def read_line(reader: asyncio.StreamReader) -> bytes:
    async with asyncio.timeout(PATIENCE_S):
        return await reader.readline()


async def sent(outlet: Outlet, data: bytes) -> None:
    async with asyncio.timeout(PATIENCE_S):
        await outlet.send(data)


async def test_a_line_waits_for_a_receiver_and_goes_to_all_of_them() -> None:
    reports: list[str] = []
    async with TcpOutlet("127.0.0.1", 0, reports.append) as outlet:
        waiting = asyncio.create_task(outlet.send(b"1\n"))
        await asyncio.sleep(0)
        assert not waiting.done()
        async with receiver(outlet.port) as first:
            assert await read_line(first) == b"1\n"
            await waiting
            async with receiver(outlet.port) as second:
                await until(lambda: len(reports) == 2)
                await sent(outlet, b"2\n")
                assert await read_line(first) == await read_line(second) == b"2\n"
            await until(lambda: len(reports) == 3)
            assert reports[-1].endswith("has disconnected; 1 other receiver")
            await sent(outlet, b"3\n")
            assert await read_line(first) == b"3\n"
        await until(lambda: len(reports) == 4)
        assert reports[-1].endswith("has disconnected; points wait at the arm")


async def test_what_a_receiver_sends_is_ignored() -> None:
    async with TcpOutlet("127.0.0.1", 0, print) as outlet:
        reader, writer = await asyncio.open_connection("127.0.0.1", outlet.port)
        writer.write(b"GET / HTTP/1.1\r\n" * 10_000)
        await sent(outlet, b"1\n")
        assert await read_line(reader) == b"1\n"
        writer.close()


async def test_a_receiver_that_does_not_read_is_disconnected_and_others_continue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outlets, "WRITE_S", 0.5)
    reports: list[str] = []
    line = b"x" * 9999 + b"\n"
    async with TcpOutlet("127.0.0.1", 0, reports.append) as outlet:
        with socket.socket() as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.connect(("127.0.0.1", outlet.port))
            async with receiver(outlet.port) as reader:
                await until(lambda: len(reports) == 2)
                for _ in range(20):
                    await sent(outlet, line)
                    assert await read_line(reader) == line
    assert any(
        "has taken nothing for 0.5 s: disconnected; 1 other" in t for t in reports
    )


async def test_receivers_that_come_and_leave_between_lines_disturb_nobody() -> None:
    async def come_and_leave(port: int) -> None:
        for _ in range(100):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.transport.abort()
            await asyncio.sleep(0)

    async with (
        TcpOutlet("127.0.0.1", 0, lambda _: None) as outlet,
        receiver(outlet.port) as reader,
    ):
        guests = asyncio.create_task(come_and_leave(outlet.port))
        n = 0
        while not guests.done():
            await sent(outlet, b"%d\n" % n)
            assert await read_line(reader) == b"%d\n" % n
            n += 1
        await guests
    assert n > 1


async def test_more_receivers_than_allowed_are_refused() -> None:
    reports: list[str] = []
    async with TcpOutlet("127.0.0.1", 0, reports.append) as outlet:
        async with contextlib.AsyncExitStack() as stack:
            for _ in range(MAX_RECEIVERS):
                await stack.enter_async_context(receiver(outlet.port))
            await until(lambda: len(reports) == MAX_RECEIVERS)
            async with receiver(outlet.port) as refused:
                assert await read_line(refused) == b""
        assert f"is refused: {MAX_RECEIVERS} receivers" in "".join(reports)


async def test_lines_continue_into_a_file_that_was_moved_away(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt"
    path.write_bytes(b"of somebody else\n")
    async with FileOutlet(path, print) as outlet:
        await sent(outlet, b"1\n")
        path.rename(tmp_path / "old.txt")
        await sent(outlet, b"2\n3\n")
    assert (tmp_path / "old.txt").read_bytes() == b"of somebody else\n1\n"
    assert path.read_bytes() == b"2\n3\n"


async def test_a_file_belongs_to_one_gateway(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt"
    reports: list[str] = []
    async with FileOutlet(path, print) as first:
        with pytest.raises(OSError, match="another program appends to it"):
            async with FileOutlet(path, print):
                pass
        path.rename(tmp_path / "old.txt")
        async with FileOutlet(path, print) as second:
            await sent(second, b"2\n")
            first._report = reports.append
            waiting = asyncio.create_task(first.send(b"1\n"))
            await until(lambda: bool(reports))
        async with asyncio.timeout(PATIENCE_S):
            await waiting
    assert "appends to it; tried again every 1 s, points wait" in reports[0]
    assert path.read_bytes() == b"2\n1\n"


async def test_a_serial_port_belongs_to_one_gateway() -> None:
    ours, theirs = pty.openpty()
    async with SerialOutlet(os.ttyname(theirs), 19200, print):
        with pytest.raises(OSError, match="another program uses it"):
            async with SerialOutlet(os.ttyname(theirs), 19200, print):
                pass
    os.close(theirs)
    os.close(ours)


def full_disk_then_file(folder: Path) -> tuple[Path, Callable[[], None]]:
    path = folder / "lines.txt"
    path.symlink_to("/dev/full")

    def mend() -> None:
        beside = folder / "new"
        beside.touch()
        beside.rename(path)

    return path, mend


def folder_lost_then_there(folder: Path) -> tuple[Path, Callable[[], None]]:
    path = folder / "usb" / "lines.txt"
    return path, path.parent.mkdir


@pytest.mark.parametrize("broken", [full_disk_then_file, folder_lost_then_there])
async def test_a_file_that_takes_nothing_is_tried_again(
    broken: Callable[[Path], tuple[Path, Callable[[], None]]], tmp_path: Path
) -> None:
    reports: list[str] = []
    path, mend = broken(tmp_path)
    async with FileOutlet(path, reports.append) as outlet:
        sending = asyncio.create_task(outlet.send(b"1\n"))
        await until(lambda: bool(reports))
        assert "tried again every 1 s, points wait at the arm" in reports[0]
        mend()
        async with asyncio.timeout(PATIENCE_S):
            await sending
    assert path.read_bytes() == b"1\n"
    assert reports[1:] == [f"{path}: takes lines again"]


async def test_a_serial_port_that_was_lost_is_opened_again(tmp_path: Path) -> None:
    reports: list[str] = []
    port = tmp_path / "port"
    ours, theirs = pty.openpty()
    port.symlink_to(os.ttyname(theirs))
    async with SerialOutlet(str(port), 19200, reports.append) as outlet:
        await sent(outlet, b"1\r\n")
        assert os.read(ours, 100) == b"1\r\n"
        os.close(theirs)
        os.close(ours)
        sending = asyncio.create_task(outlet.send(b"2\r\n"))
        await until(lambda: bool(reports))
        ours, theirs = pty.openpty()
        port.unlink()
        port.symlink_to(os.ttyname(theirs))
        async with asyncio.timeout(PATIENCE_S):
            await sending
        assert os.read(ours, 100) == b"2\r\n"
    assert reports[-1] == f"{port}: takes lines again"
    os.close(theirs)
    os.close(ours)


async def test_a_datagram_a_line_and_a_word_where_nobody_listens() -> None:
    reports: list[str] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taker:
        taker.bind(("127.0.0.1", 0))
        taker.settimeout(PATIENCE_S)
        port = taker.getsockname()[1]
        async with UdpOutlet("127.0.0.1", port, reports.append) as outlet:
            await sent(outlet, b"1\n2\n")
            assert [taker.recv(100), taker.recv(100)] == [b"1\n", b"2\n"]
    async with UdpOutlet("127.0.0.1", port, reports.append) as outlet:
        sending = asyncio.create_task(outlet.send(b"3\n"))
        await until(lambda: bool(reports))
        assert "Connection refused; tried again" in reports[0]
        sending.cancel()
