"""A serial port opened for one reader alone, read as bytes arrive.

pyserial's own exclusive mode is an advisory lock; TIOCEXCL also excludes programs that
do not lock it (but not root). Low latency matters for FTDI adapters, whose timer
otherwise holds bytes back for 16 ms; other ports refuse the setting.
"""

import contextlib
import errno
import fcntl
import os
import select
import termios
import time

import serial

from traverse.drivers.base.values import DeviceError, DeviceNotFoundError

READ_BYTES = 65_536
WRITE_TIMEOUT_S = 0.5
BUSY_TRIES, BUSY_PAUSE_S = 5, 0.1


class SerialPort:
    """An open port.

    Args:
        path: device file, best one below /dev/serial/by-id.
        baud_rate: bits per second; without meaning on USB-CDC and ptys.
        wake_fd: a non-blocking pipe; bytes in it end `wait` early and are eaten.
        parity: "N", "E" or "O"; a pty takes none but "N".
        stop_bits: 1 or 2.

    Attributes:
        latency_ns: how long an adapter and the host may hold every byte back.
        byte_ns: duration of a byte on the line; 0 where there is none.

    Raises:
        DeviceNotFoundError: it is missing, in use, or not permitted.
    """

    def __init__(
        self,
        path: str,
        baud_rate: int,
        wake_fd: int,
        *,
        parity: str = "N",
        stop_bits: int = 1,
    ) -> None:
        self._port = _opened(path, baud_rate, parity, stop_bits)
        self._fd = self._port.fileno()
        self._wake_fd = wake_fd
        self._poll = select.poll()
        for descriptor in (self._fd, wake_fd):
            self._poll.register(descriptor, select.POLLIN)
        self.path = path
        with contextlib.suppress(OSError, ValueError):
            self._port.set_low_latency_mode(True)
        self.latency_ns, self.byte_ns = _delays(path, baud_rate)
        with contextlib.suppress(OSError):
            fcntl.ioctl(self._fd, termios.TIOCEXCL)
        try:
            self._port.reset_input_buffer()
        except (OSError, termios.error) as error:
            self.close()
            raise _explain(path, error) from error

    def fileno(self) -> int:
        return self._fd

    def wait(self, seconds: float) -> bool:
        """Wait for bytes; False after ``seconds`` or a wake-up without any.

        A wake-up together with bytes is reported when they have been read.
        """
        ready = [descriptor for descriptor, _ in self._poll.poll(seconds * 1e3)]
        if self._fd in ready:
            return True
        if ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self._wake_fd, 4096)
        return False

    def read(self) -> bytes:
        # An empty read is silence as well as the end: only of a port that has
        # something to read, and yields nothing, it is the end.
        data = self._available_bytes()
        if not data and select.select([self._fd], [], [], 0.0)[0]:
            data = self._available_bytes()
            if not data:
                raise self._lost_error("end of file")
        return data

    def write(self, data: bytes) -> None:
        try:
            n_written = 0
            with contextlib.suppress(BlockingIOError):
                n_written = os.write(self._fd, data)
            if n_written < len(data):  # the rest as room for it comes about
                self._port.write(data[n_written:])
        except (serial.SerialException, OSError) as error:
            raise self._lost_error(str(error)) from error

    def close(self) -> None:
        with contextlib.suppress(OSError, termios.error):
            fcntl.ioctl(self._fd, termios.TIOCNXCL)
        with contextlib.suppress(OSError, serial.SerialException):
            self._port.close()

    def _available_bytes(self) -> bytes:
        try:
            return os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost_error(error.strerror or str(error)) from error

    def _lost_error(self, reason: str) -> DeviceError:
        return DeviceError(
            f"port {self.path} has gone away ({reason})", "check cable and power"
        )


PTY_LATENCY_NS, USB_LATENCY_NS = 200_000, 1_000_000
BITS_PER_BYTE = 10


def _delays(path: str, baud_rate: int) -> tuple[int, int]:
    """Return least delays of bytes by the kind of port [ns].

    An FTDI adapter collects bytes as its driver states, others for a frame of the bus.
    For USB-CDC an unknown line at its baud rate is assumed.
    """
    real = os.path.realpath(path)
    if real.startswith("/dev/pts/"):
        return PTY_LATENCY_NS, 0
    byte_ns = round(1e9 * BITS_PER_BYTE / baud_rate)
    timer = f"/sys/class/tty/{os.path.basename(real)}/device/latency_timer"
    with contextlib.suppress(OSError, ValueError), open(timer, "rb") as file:
        return int(file.read()) * 1_000_000, byte_ns
    return USB_LATENCY_NS, byte_ns


def _opened(path: str, baud_rate: int, parity: str, stop_bits: int) -> serial.Serial:
    """Open the port; waits a moment for a program that is just releasing it.

    Raises:
        DeviceNotFoundError: it is missing, in use, or not permitted.
    """
    left = BUSY_TRIES
    while True:
        left -= 1
        try:
            return serial.Serial(
                path,
                baud_rate,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True,
                parity=parity,
                stopbits=stop_bits,
            )
        except (OSError, ValueError, termios.error) as error:
            busy = getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY)
            if not (busy and left):
                raise _explain(path, error) from error
        time.sleep(BUSY_PAUSE_S)


def _explain(path: str, error: Exception) -> DeviceNotFoundError:
    number = getattr(error, "errno", None)
    if isinstance(error.__context__, termios.error):  # pyserial has put it into words
        number = error.__context__.args[0]
    if number == errno.ENOENT:
        reason, remedy = "there is no such port", "plug the device in, check its name"
    elif number == errno.EPERM and "INVOCATION_ID" in os.environ:
        reason = "not permitted by systemd"  # the file's own mode gives EACCES
        remedy = (
            "allow this kind of port in a drop-in of the unit: DeviceAllow=char-NAME "
            "rw, with its NAME in /proc/devices"
        )
    elif number in (errno.EACCES, errno.EPERM):
        reason = "not permitted"
        remedy = "add the service's user to the group dialout"
    elif number in (errno.EAGAIN, errno.EBUSY):
        reason, remedy = "in use by another program", "stop that program"
    else:
        reason = os.strerror(number) if number else str(error)
        remedy = "check that this is a serial port"
    return DeviceNotFoundError(f"cannot open {path}: {reason}", remedy)
