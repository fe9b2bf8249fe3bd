"""A pty that looks like a serial port at a fixed path."""

import contextlib
import fcntl
import os
import select
import termios
import time
import tty
from collections import deque
from pathlib import Path

from traverse.simulator.scenario.signals import OutgoingFrame

RESERVE_BYTES = 262_144  # for frames that may not be dropped


class PtyPort:
    """The board's end of a pty; whole frames go out or none.

    Nothing is sent while no host holds the other end, as on a USB line. The path is a
    symlink, made anew.
    """

    def __init__(self, path: Path, buffer_bytes: int) -> None:
        self.path = path
        self._buffer_bytes = buffer_bytes
        self._waiting: deque[bytes] = deque()
        self._n_waiting_bytes = 0
        self._held = False
        self._make()

    def _make(self) -> None:
        self.descriptor, device_side = os.openpty()
        try:
            tty.setraw(device_side)
            os.set_blocking(self.descriptor, False)
            self._target = os.ttyname(device_side)
            _link(self.path, self._target)
        finally:
            os.close(device_side)
        self._poll = select.poll()
        self._poll.register(self.descriptor, select.POLLIN)
        # While no host holds the other end the descriptor is always ready, to report
        # the hang-up; this one becomes ready when a new host writes.
        self._changes = select.epoll()
        self._changes.register(self.descriptor, select.EPOLLIN | select.EPOLLET)
        self._changes.poll(0)

    def close(self) -> None:
        if self.descriptor < 0:
            return
        if self.path.is_symlink() and str(self.path.readlink()) == self._target:
            self.path.unlink()
        self._changes.close()
        os.close(self.descriptor)
        self.descriptor = -1

    @property
    def backlog(self) -> bool:
        return bool(self._waiting)

    @property
    def held(self) -> bool:
        return self._held

    def readers(self) -> list[int]:
        return [self.descriptor if self._held else self._changes.fileno()]

    def writers(self) -> list[int]:
        """Return descriptors to wait for until the host takes waiting bytes."""
        return [self.descriptor] if self._waiting else []

    @property
    def host_speed(self) -> int:
        """Speed set by the host, as a constant of termios."""
        return int(termios.tcgetattr(self.descriptor)[4])

    def host_changed(self) -> bool:
        self._changes.poll(0)
        state = self._poll.poll(0)
        held = not any(flags & select.POLLHUP for _, flags in state)
        changed, self._held = held != self._held, held
        if changed:
            self._waiting.clear()
            self._n_waiting_bytes = 0
            if not held:
                self._received()  # of a host that has left
                self._open_to_all()
        return changed

    def _open_to_all(self) -> None:
        """Make the other end available, also if the last host locked it.

        A pty stays exclusive (TIOCEXCL) when its host is killed, until both ends are
        closed; a USB line does not. A process without the right to open such a pty
        cannot change that, and makes a new one for the symlink.
        """
        try:
            descriptor = os.open(self._target, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            worn, watched = self.descriptor, self._changes
            self._make()
            watched.close()
            os.close(worn)
            return
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
        os.close(descriptor)
        self._changes.poll(0)  # of our own opening and closing

    def read(self) -> bytes:
        """Return the host's bytes; they are kept until the host is detected."""
        return self._received() if self._held else b""

    def _received(self) -> bytes:
        try:
            return os.read(self.descriptor, 65536)
        except OSError:
            return b""  # nothing there, or no host: `host_changed` finds out

    def write(self, frames: list[OutgoingFrame]) -> int:
        """Send frames as far as the line takes them.

        Returns:
            How many samples were dropped.
        """
        n_dropped = 0
        most_bytes = self._buffer_bytes + RESERVE_BYTES
        for frame in frames:
            size = len(frame.data)
            full = self._n_waiting_bytes + size > self._buffer_bytes
            if frame.is_sample and (full or not self._held):
                n_dropped += 1
            elif self._held and self._n_waiting_bytes + size < most_bytes:
                self._waiting.append(frame.data)
                self._n_waiting_bytes += size
        self.flush()
        return n_dropped

    def drain(self, most_s: float) -> None:
        """Send waiting bytes, and wait up to a time for the host to take them."""
        until_s = time.monotonic() + most_s
        while (
            self._waiting and self._held and (left_s := until_s - time.monotonic()) > 0
        ):
            select.select([], [self.descriptor], [], left_s)
            self.flush()

    def flush(self) -> None:
        while self._waiting and self._held:
            chunk = b"".join(self._waiting)
            try:
                n_sent = os.write(self.descriptor, chunk)
            except OSError:
                return  # full, or the host has just left
            self._waiting.clear()
            if n_sent < len(chunk):
                self._waiting.append(chunk[n_sent:])
            self._n_waiting_bytes = len(chunk) - n_sent


def _link(path: Path, target: str) -> None:
    """Make a symlink, replacing one of an earlier run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_symlink():
        raise FileExistsError(f"{path} exists and is no symlink; choose another port")
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(target)
    fresh.replace(path)
