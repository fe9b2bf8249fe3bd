"""What a driver needs of a serial port; a simulated line can stand in for it."""

from collections.abc import Callable
from typing import Protocol


class BytePort(Protocol):
    """An open port, as `traverse.drivers.io.serial_port.SerialPort` is one.

    All but `close` and `fileno` raise DeviceError when the port has gone away.
    """

    def fileno(self) -> int:
        """For waiting for several ports together."""

    def wait(self, seconds: float) -> bool:
        """Wait for bytes; False after ``seconds`` or a wake-up without any."""

    def read(self) -> bytes:
        """What there is, after `wait` has said that there is something."""

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""

    def close(self) -> None:
        """Close; never raises."""


OpenPort = Callable[[str, int, int], BytePort]
"""Opens a port by its path, baud rate and the pipe that wakes who waits for it."""
