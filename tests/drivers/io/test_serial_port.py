import contextlib
import fcntl
import os
import termios
import tty

import pytest

from traverse.drivers.base.values import DeviceError
from traverse.drivers.io.serial_port import SerialPort


@pytest.fixture
def line():
    master, slave = os.openpty()
    tty.setraw(slave)
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK)
    port = SerialPort(os.ttyname(slave), 115_200, wake_read)
    os.close(slave)
    yield port, master, wake_write
    port.close()
    for number in (wake_read, wake_write):
        os.close(number)
    with contextlib.suppress(OSError):  # a test may have closed it
        os.close(master)


def unread(pipe: int) -> int:
    return int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), "little")


def test_reading_when_nothing_has_come_gives_nothing(line):
    port, master, _ = line
    assert port.read() == b""
    os.write(master, b"hello")
    assert port.wait(5.0)
    assert port.read() == b"hello"
    assert port.read() == b""


def test_a_waker_ends_the_waiting_without_bytes(line):
    port, _, wake_write = line
    os.write(wake_write, b"\0")
    assert not port.wait(5.0)
    assert port.read() == b""


def test_a_waker_that_comes_with_bytes_is_reported_when_they_have_been_read(line):
    port, master, wake_write = line
    os.write(master, b"hello")
    os.write(wake_write, b"\0")
    assert port.wait(5.0)
    assert unread(wake_write) == 1
    assert port.read() == b"hello"
    assert not port.wait(5.0)
    assert unread(wake_write) == 0


def test_a_port_whose_other_end_is_gone_is_reported(line):
    port, master, _ = line
    os.close(master)
    assert port.wait(5.0)
    with pytest.raises(DeviceError, match="has gone away"):
        port.read()
