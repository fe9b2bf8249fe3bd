"""Interface to serial ports and waiting, replaceable by simulated lines."""

import contextlib
import os
import select
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from traverse.drivers.io.serial_port import SerialPort


class BytePort(Protocol):
    """An open port, such as `traverse.drivers.io.serial_port.SerialPort`.

    Attributes:
        latency_ns: how long an adapter and the host may hold every byte back.
        byte_ns: duration of a byte on the line.

    All but `close` and `fileno` raise DeviceError when the port has disappeared.
    """

    latency_ns: int
    byte_ns: int

    def fileno(self) -> int:
        """Return a descriptor, for waiting for several ports."""

    def wait(self, seconds: float) -> bool:
        """Wait for bytes; False after ``seconds`` or a wake-up without any."""

    def read(self) -> bytes:
        """Read available bytes, after `wait` has returned True."""

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""

    def close(self) -> None:
        """Close; never raises."""


WaitForAny = Callable[[Sequence[BytePort], int, float], list[int]]


OpenPort = Callable[..., BytePort]
"""Opens a port, with the arguments of the constructor of `SerialPort`."""


def wait_for_any(ports: Sequence[BytePort], wake_fd: int, seconds: float) -> list[int]:
    """Wait for bytes; return numbers of ports with some, none after ``seconds``.

    Without ports it waits for a wake-up alone.

    Bytes in the non-blocking pipe ``wake_fd`` end the wait early and are consumed.
    """
    numbers = [port.fileno() for port in ports]
    ready, _, _ = select.select([*numbers, wake_fd], [], [], seconds)
    if wake_fd in ready:
        with contextlib.suppress(BlockingIOError):
            os.read(wake_fd, 4096)
    return [index for index, number in enumerate(numbers) if number in ready]


@dataclass(frozen=True, slots=True)
class PortAccess:
    """How a driver opens ports and waits; replaced as a whole by virtual time."""

    open: OpenPort = SerialPort
    wait_for_any: WaitForAny = wait_for_any


SERIAL_PORTS = PortAccess()
