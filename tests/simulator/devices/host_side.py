import os
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from traverse.simulator.devices.device import SimulatedDevice


def heard(host: int) -> bytes:
    """All that has been written to the other side.

    Read until there is no more: the kernel hands bytes on behind the writer's back, and
    only a read that finds nothing waits for those.
    """
    data = b""
    try:
        while piece := os.read(host, 4096):
            data += piece
    except BlockingIOError:
        return data
    return data


def opened(path: Path) -> int:
    """A port as a host opens it: raw, and reads do not wait."""
    host = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(host)
    return host


@contextmanager
def hosts_of(device: SimulatedDevice, *paths: Path) -> Iterator[list[int]]:
    """All ports of a device, opened; at the end both sides are closed."""
    hosts = [opened(path) for path in paths]
    try:
        yield hosts
    finally:
        device.close()
        for host in hosts:
            os.close(host)
