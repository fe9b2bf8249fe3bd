"""Virtual time for drivers of polled devices: no port, no waiting, no chance.

The driver's thread is the only one that works. When it waits, simulated devices run
until their next action, until bytes arrive or the timeout ends. A cable in memory
carries the bytes: it replaces the pty on the device's side and the port on the
driver's.
"""

import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol
from unittest.mock import patch

from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import Delivery, DeviceError
from traverse.simulator.scenario.signals import OutgoingFrame

FIRST_NS = 10**12
AFTERWARDS_S = 0.001  # real time that a wait takes once all is over
BETWEEN_TRIES_S = 0.1  # that pass when the clock is looked at between two connections


class Living(Protocol):
    """An inhabitant of virtual time, such as a simulated device."""

    def live(self, now_s: float) -> None:
        """Call the due functions."""

    def next_due_s(self, block_s: float) -> float:
        """When something is due."""


class VirtualTime:
    """Monotonic time that advances in waits; it still advances after the end."""

    def __init__(self, end_s: float) -> None:
        self.now_s = 0.0
        self.devices: list[Living] = []
        self.cables: list[Cable] = []
        self.over = threading.Event()
        self._end_s = end_s

    def monotonic_ns(self) -> int:
        """The host's clock; who has no port open has nothing but the clock to wait."""
        if self.cables and not any(cable.held for cable in self.cables):
            self.go_on(BETWEEN_TRIES_S)
        return FIRST_NS + round(1e9 * self.now_s)

    def wait_for_any(
        self, ports: Sequence[Any], wake_fd: int, seconds: float
    ) -> list[int]:
        """Let the time pass until a port has bytes; for `PolledDriver`."""
        del wake_fd
        self.go_on(seconds, lambda: any(port.ready for port in ports))
        return [index for index, port in enumerate(ports) if port.ready]

    def go_on(self, seconds: float, until: Callable[[], bool] = bool) -> bool:
        """Let time pass until something has happened, at most so long."""
        if self.over.is_set():
            time.sleep(AFTERWARDS_S)
        to_s = self.now_s + seconds
        while not until():
            due_s = min((d.next_due_s(0.0) for d in self.devices), default=to_s)
            self.now_s = max(self.now_s, min(due_s, to_s))
            for device in self.devices:
                device.live(self.now_s)
            if self.now_s >= self._end_s:
                self.over.set()
            if due_s > to_s:
                return until()
        return True


class Cable:
    """Bytes on their way between a device and the host.

    Args:
        time: in which they are waited for.

    Attributes:
        plugged: False: the host's end is gone.
    """

    def __init__(self, time: VirtualTime) -> None:
        self.time = time
        self.to_device = b""
        self.to_host = b""
        self.held = False
        self.plugged = True
        time.cables.append(self)

    def open_port(
        self, path: str, baud_rate: int, wake_fd: int, **line: object
    ) -> "HostEnd":
        del baud_rate, wake_fd
        if not self.plugged:
            raise DeviceError(f"cannot open {path}: there is no such port", "plug it")
        return HostEnd(self.held_by_host(), path)

    def held_by_host(self) -> "Cable":
        self.held = True
        return self


class HostEnd:
    """The end of a cable that a driver reads, a `BytePort`."""

    latency_ns = byte_ns = 0  # of an adapter, which there is none

    def __init__(self, cable: Cable, path: str) -> None:
        self._cable = cable
        self.path = path

    @property
    def ready(self) -> bool:
        return bool(self._cable.to_host) or not self._cable.plugged

    def fileno(self) -> int:
        return -1

    def wait(self, seconds: float) -> bool:
        return self._cable.time.go_on(seconds, lambda: self.ready)

    def read(self) -> bytes:
        self._check()
        data, self._cable.to_host = self._cable.to_host, b""
        return data

    def write(self, data: bytes) -> None:
        self._check()
        self._cable.to_device += data
        for device in self._cable.time.devices:
            device.live(self._cable.time.now_s)

    def close(self) -> None:
        self._cable.held = False

    def _check(self) -> None:
        if not self._cable.plugged:
            raise DeviceError("the port has gone away", "check the cable")


class DeviceEnd:
    """The end of a cable that takes the place of the simulator's `PtyPort`."""

    host_speed = termios.B115200  # what most ask for

    def __init__(self, cable: Cable) -> None:
        self._cable = cable
        self._was_held = False

    def host_changed(self) -> bool:
        changed, self._was_held = self._cable.held != self._was_held, self._cable.held
        return changed

    def read(self) -> bytes:
        data, self._cable.to_device = self._cable.to_device, b""
        return data

    def write(self, frames: Sequence[OutgoingFrame]) -> int:
        self._cable.to_host += b"".join(frame.data for frame in frames)
        return 0

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing is held."""


@contextmanager
def lines_through(cables: Sequence[Cable]) -> Iterator[None]:
    """Simulated serial devices that are made meanwhile take these cables in turn."""
    left = iter(cables)

    def end_of_next(path: Path, buffer_bytes: int) -> DeviceEnd:
        del path, buffer_bytes
        return DeviceEnd(next(left))

    with (
        patch("traverse.simulator.devices.serial_line.PtyPort", end_of_next),
        patch("traverse.simulator.devices.latch_board.device.PtyPort", end_of_next),
    ):
        yield


class Straight:
    """Takes deliveries in the driver's own thread, in the place of a queue."""

    dropped_samples = 0
    dropped_others = 0

    def __init__(self, over: threading.Event) -> None:
        self.all: list[Delivery] = []
        self._over = over

    def put(self, delivery: Delivery, *, wakes: bool = True) -> bool:
        if not self._over.is_set():
            self.all.append(delivery)
        return True

    def wake(self) -> None:
        """Do nothing: deliveries are taken as they are put."""


def played(driver: Driver, over: threading.Event, patience_s: float = 60.0) -> None:
    """Let a driver live until its time is over.

    Raises:
        TimeoutError: It does not get there.
    """
    with driver:
        if not over.wait(patience_s):
            raise TimeoutError(f"not over within {patience_s:g} s")
