"""Waits for whichever of several ports has bytes first."""

import contextlib
import os
import select
from collections.abc import Callable, Sequence

from traverse.drivers.io.byte_port import BytePort

WaitForAny = Callable[[Sequence[BytePort], int, float], list[int]]


def wait_for_any(ports: Sequence[BytePort], wake_fd: int, seconds: float) -> list[int]:
    """Wait for bytes; numbers of the ports that have some, none after ``seconds``.

    Args:
        ports: to wait for.
        wake_fd: a non-blocking pipe; bytes in it end the wait early and are eaten.
        seconds: to wait at most.
    """
    numbers = [port.fileno() for port in ports]
    ready, _, _ = select.select([*numbers, wake_fd], [], [], seconds)
    if wake_fd in ready:
        with contextlib.suppress(BlockingIOError):
            os.read(wake_fd, 4096)
    return [index for index, number in enumerate(numbers) if number in ready]
