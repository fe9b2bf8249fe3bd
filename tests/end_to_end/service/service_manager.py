"""systemd's side of sd_notify, and a way to stop a single thread of another process."""

import contextlib
import ctypes
import os
import platform
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

SEIZE, INTERRUPT, DETACH = 0x4206, 0x4207, 17
WAIT_ALL = 0x40000000  # __WALL: also for threads
# Numbers of select and poll in all their kinds: a thread in one of them holds no lock.
WAITING = {"x86_64": (7, 23, 270, 271), "aarch64": (72, 73)}


class Manager:
    """Receives services' messages, in order.

    Attributes:
        heard: datagrams so far, each as its lines.
    """

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)
        self.heard: list[list[str]] = []

    def listen(self) -> list[str]:
        """Receive all that has arrived; return all lines so far."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self.heard.append(self._socket.recv(65536).decode().split("\n"))
        return [line for lines in self.heard for line in lines]

    def has(self, line: str, times: int = 1) -> bool:
        """Whether a line was received this many times."""
        return self.listen().count(line) >= times

    def status(self) -> str:
        lines = [x for x in self.listen() if x.startswith("STATUS=")]
        return lines[-1].removeprefix("STATUS=") if lines else ""

    def close(self) -> None:
        self._socket.close()


@contextlib.contextmanager
def stopped_thread(process: int, name: str) -> Iterator[None]:
    """Stop one thread of a child process, by the kernel, while the block lasts."""
    threads = Path(f"/proc/{process}/task").iterdir()
    thread = next(p for p in threads if (p / "comm").read_text("utf-8") == f"{name}\n")
    number = int(thread.name)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.ptrace.argtypes = [ctypes.c_long] * 4
    libc.ptrace.restype = ctypes.c_long
    if libc.ptrace(SEIZE, number, 0, 0):
        pytest.skip(f"this system permits no ptrace: {os.strerror(ctypes.get_errno())}")
    try:
        waiting = WAITING.get(platform.machine(), ())
        calls = iter(lambda: (thread / "syscall").read_text("ascii"), None)
        next(c for c in calls if c.split()[0] in map(str, waiting) or not waiting)
        assert libc.ptrace(INTERRUPT, number, 0, 0) == 0
        os.waitpid(number, WAIT_ALL)
        yield
    finally:
        assert libc.ptrace(DETACH, number, 0, 0) == 0
