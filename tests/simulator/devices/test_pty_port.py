import fcntl
import os
import struct
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from traverse.simulator.devices.pty_port import PtyPort
from traverse.simulator.scenario.signals import OutgoingFrame

NOBODY = 65534
TIOCGEXCL = 0x80045440


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    port = PtyPort(tmp_path / "tty", 1000)
    yield port
    port.close()


@pytest.fixture
def without_privileges(tmp_path: Path) -> Iterator[None]:
    """Root may open an exclusive port: switch user, if root runs the tests."""
    if os.geteuid() != 0:
        yield
        return
    os.chown(tmp_path, NOBODY, -1)
    working = Path.cwd()
    os.chdir(tmp_path)  # the folders above are root's alone
    os.seteuid(NOBODY)
    yield
    os.seteuid(0)
    os.chdir(working)


def opened(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def end_as_killed(port: PtyPort) -> str:
    """Open the port for a host alone, end the host; return the name of its terminal."""
    host = opened(port.path)
    assert port.host_changed()
    fcntl.ioctl(host, termios.TIOCEXCL)
    name = os.ttyname(host)
    os.close(host)  # without TIOCNXCL, as the kernel does it at a program's end
    return name


def assert_works(port: PtyPort, host: int) -> None:
    assert port.host_changed()
    os.write(host, b"anybody there?")
    assert port.read() == b"anybody there?"
    port.write([OutgoingFrame(is_sample=False, data=b"here")])
    assert os.read(host, 100) == b"here"
    os.close(host)
    assert port.host_changed()


def test_a_host_that_was_killed_leaves_the_port_to_anybody(port: PtyPort) -> None:
    end_as_killed(port)
    assert port.host_changed()
    host = opened(port.path)
    assert struct.unpack("i", fcntl.ioctl(host, TIOCGEXCL, bytes(4))) == (0,)
    assert_works(port, host)


@pytest.mark.usefixtures("without_privileges")
def test_the_port_is_open_again_where_nobody_may_open_what_is_exclusive() -> None:
    port = PtyPort(Path("tty"), 1000)
    try:
        before = end_as_killed(port)
        with pytest.raises(OSError, match="busy"):
            opened(port.path)
        assert port.host_changed()
        assert str(port.path.readlink()) != before
        assert_works(port, opened(port.path))
    finally:
        port.close()
    assert not port.path.is_symlink()


def test_a_host_that_closes_in_order_finds_the_same_port_again(port: PtyPort) -> None:
    for _ in range(3):
        before = port.path.readlink()
        assert_works(port, opened(port.path))
        assert port.path.readlink() == before


def test_what_a_quick_next_host_says_is_kept(port: PtyPort) -> None:
    end_as_killed(port)
    assert port.host_changed()
    host = opened(port.path)
    os.write(host, b"first word")
    assert port.read() == b""  # no host has been detected yet
    assert port.host_changed()
    assert port.read() == b"first word"
    os.close(host)
