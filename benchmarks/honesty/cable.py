"""Cables in memory between a simulated device and the host.

`DeviceEnd` replaces the simulator's `PtyPort`, `HostEnd` the drivers' `SerialPort`.
"""

import termios
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from traverse.drivers.base.values import DeviceError, DeviceNotFoundError
from traverse.simulator.scenario.signals import OutgoingFrame

USB_LATENCY_S = 1e-3  # that a port states at least, as those of USB do
BITS_PER_BYTE = 10
NEVER_S = float("inf")


class Timekeeper(Protocol):
    """The world as seen by ends of a cable: `Hub` is one.

    Attributes:
        ports: of the host, by path.
    """

    now_s: float
    ports: "dict[str, Cable]"

    def monotonic_ns(self) -> int:
        """The host's monotonic clock."""

    def wait(self, seconds: float, ready: Callable[[], bool] = bool) -> bool:
        """Wait within a reader, until something is ready, a wake-up or the end."""


@dataclass(slots=True)
class Delay:
    """Delay of bytes in one direction.

    Attributes:
        bunch_s: bytes arrive together, in steps of so long; 0: one by one.
    """

    least_s: float
    usual_s: float
    bunch_s: float
    rng: np.random.Generator
    last_s: float = 0.0

    def arrives_s(self, now_s: float) -> float:
        """Return when bytes that leave now arrive; never before earlier ones."""
        at_s = now_s + self.least_s
        if self.usual_s:
            at_s += float(self.rng.exponential(self.usual_s))
        if self.bunch_s:
            at_s = np.ceil(at_s / self.bunch_s) * self.bunch_s
        self.last_s = max(at_s, self.last_s)
        return self.last_s


@dataclass(eq=False)
class Cable:
    """A cable to one device.

    Attributes:
        to_host: Arrival, and bytes or a frame.
        to_device: The same of the other direction.
        plugged: False: the host's end is gone.
        attached: The device has power and holds its end.
        generation: Changes whenever the port appears anew.
    """

    hub: Timekeeper
    down: Delay
    up: Delay
    to_host: deque[tuple[float, Any]] = field(default_factory=deque)
    to_device: deque[tuple[float, Any]] = field(default_factory=deque)
    plugged: bool = True
    attached: bool = False
    held: bool = False
    generation: int = 0
    speed: int = termios.B115200
    n_waiting: int = 0
    touched: bool = False  # the device must look at its end

    @property
    def is_there(self) -> bool:
        return self.plugged and self.attached

    def device_due_s(self) -> float:
        if self.touched:
            return self.hub.now_s
        return self.to_device[0][0] if self.to_device else NEVER_S

    def host_due_s(self) -> float:
        return self.to_host[0][0] if self.to_host else NEVER_S

    def unplug(self) -> None:
        self.plugged = self.held = False
        self.generation += 1
        self.clear()

    def plug(self) -> None:
        self.plugged = True

    def clear(self) -> None:
        """Lose bytes under way."""
        self.to_host.clear()
        self.to_device.clear()
        self.n_waiting = 0
        self.touched = True


class DeviceEnd:
    """The device's end, as long as it has power."""

    def __init__(self, cable: Cable, buffer_bytes: int) -> None:
        self._cable, self._buffer_bytes = cable, buffer_bytes
        self._was_held = False
        cable.attached = True
        self.descriptor = -1

    @property
    def host_speed(self) -> int:
        """Speed of the host's end, as a constant of termios."""
        return self._cable.speed

    @property
    def held(self) -> bool:
        return self._cable.held

    @property
    def backlog(self) -> bool:
        return bool(self._cable.to_host)

    def host_changed(self) -> bool:
        self._cable.touched = False
        changed, self._was_held = self._cable.held != self._was_held, self._cable.held
        return changed

    def read(self) -> bytes:
        cable, now_s = self._cable, self._cable.hub.now_s
        parts = []
        while cable.to_device and cable.to_device[0][0] <= now_s:
            parts.append(cable.to_device.popleft()[1])
        return b"".join(parts)

    def write(self, frames: Sequence[OutgoingFrame]) -> int:
        cable, n_dropped = self._cable, 0
        data = []
        for frame in frames:
            full = cable.n_waiting + len(frame.data) > self._buffer_bytes
            if full or not (cable.held and cable.plugged):
                n_dropped += frame.is_sample
            else:
                data.append(frame.data)
                cable.n_waiting += len(frame.data)
        if sent := b"".join(data):
            cable.to_host.append((cable.down.arrives_s(cable.hub.now_s), sent))
        return n_dropped

    def flush(self) -> None:
        """Nothing waits here."""

    def drain(self, most_s: float) -> None:
        """Nothing waits here."""

    def readers(self) -> list[int]:
        return []

    def writers(self) -> list[int]:
        return []

    def close(self) -> None:
        """The device loses power: the port disappears."""
        if self._cable.attached:
            self._cable.attached = self._cable.held = False
            self._cable.generation += 1
            self._cable.clear()


class HostEnd:
    """An open port of the host, a `BytePort`.

    Attributes:
        latency_ns: how long it may hold bytes back, as its kind of port states: an
            adapter that bunches them has a timer that the kernel shows.
        byte_ns: duration of a byte on the line.
    """

    def __init__(self, cable: Cable, path: str, baud_rate: int) -> None:
        self._cable, self.path = cable, path
        self.latency_ns = round(1e9 * max(USB_LATENCY_S, cable.down.bunch_s))
        self.byte_ns = round(1e9 * BITS_PER_BYTE / baud_rate)
        self._generation = cable.generation
        cable.held = cable.touched = True
        cable.to_host.clear()
        cable.n_waiting = 0

    @property
    def is_gone(self) -> bool:
        return self._cable.generation != self._generation

    @property
    def ready(self) -> bool:
        return self.is_gone or self._cable.host_due_s() <= self._cable.hub.now_s

    def fileno(self) -> int:
        return -1

    def wait(self, seconds: float) -> bool:
        return self._cable.hub.wait(seconds, lambda: self.ready)

    def read(self) -> bytes:
        """Return bytes that have arrived.

        Raises:
            DeviceError: the port has disappeared.
        """
        self._check()
        cable, now_s, parts = self._cable, self._cable.hub.now_s, []
        while cable.to_host and cable.to_host[0][0] <= now_s:
            parts.append(cable.to_host.popleft()[1])
            cable.n_waiting -= len(parts[-1])
        return b"".join(parts)

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            DeviceError: the port has disappeared.
        """
        self._check()
        cable = self._cable
        cable.to_device.append((cable.up.arrives_s(cable.hub.now_s), data))

    def close(self) -> None:
        if not self.is_gone:
            self._cable.held, self._cable.touched = False, True

    def _check(self) -> None:
        if self.is_gone:
            raise DeviceError(f"port {self.path} has gone away", "check the cable")


def open_host_end(hub: Timekeeper, path: str, baud_rate: int) -> HostEnd:
    """Open a port of the host by its path.

    Raises:
        DeviceNotFoundError: There is no such port.
    """
    cable = hub.ports.get(path)
    if cable is None or not cable.is_there:
        raise DeviceNotFoundError(f"cannot open {path}: there is no such port", "plug")
    cable.speed = getattr(termios, f"B{baud_rate}", termios.B115200)
    return HostEnd(cable, path, baud_rate)
