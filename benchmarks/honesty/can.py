"""A CAN bus in memory: the driver's `CanBus` and the simulator's `CanLine`."""

from collections.abc import Sequence
from typing import Any

from benchmarks.honesty.cable import Cable
from traverse.drivers.base.values import DeviceError, DeviceNotFoundError
from traverse.drivers.io.can_bus import MOST_AT_ONCE, Frame
from traverse.simulator.devices.canopen.can_line import CanLine

ERROR_FLAG = 0x2000_0000


class HostBus:
    """The host's end, in the place of `traverse.drivers.io.can_bus.CanBus`.

    A frame has the time at which the program reads it, as on interfaces without
    kernel time stamps.
    """

    has_kernel_sync = False
    dropped = 0

    def __init__(self, cable: Cable, name: str) -> None:
        if not cable.is_there:
            raise DeviceNotFoundError(f"cannot open the bus {name}", "plug it in")
        self.name = name
        self._cable = cable
        self._generation = cable.generation
        cable.held = cable.touched = True
        cable.to_host.clear()

    def receive(self, timeout_s: float) -> Sequence[Frame]:
        hub, arrived = self._cable.hub, self._cable.to_host
        hub.wait(
            timeout_s,
            lambda: self._is_gone or bool(arrived and arrived[0][0] <= hub.now_s),
        )
        self._check()
        frames: list[Frame] = []
        while arrived and arrived[0][0] <= hub.now_s and len(frames) < MOST_AT_ONCE:
            can_id, data = arrived.popleft()[1]
            frames.append((can_id, data, hub.monotonic_ns()))
        return frames

    def send(self, can_id: int, data: bytes) -> None:
        self._check()
        cable = self._cable
        at_s = cable.up.arrives_s(cable.hub.now_s)
        cable.to_device.append((at_s, (can_id, bytes(data))))

    def send_periodically(self, can_id: int, period_s: float) -> Any:  # noqa: ANN401
        """There is no kernel here."""
        raise DeviceError("no kernel sends frames here", "let the program send them")

    def close(self) -> None:
        if not self._is_gone:
            self._cable.held = False

    @property
    def _is_gone(self) -> bool:
        return self._cable.generation != self._generation

    def _check(self) -> None:
        if self._is_gone:
            raise DeviceError(f"the bus {self.name} is gone", "check the adapter")


class MemoryLine(CanLine):
    """The nodes' end, in the place of the simulator's `LibraryLine`."""

    def __init__(self, cable: Cable, where: str) -> None:
        super().__init__(where)
        self._cable = cable
        cable.attached = True

    def receive(self) -> list[tuple[int, bytes]]:
        waiting, now_s = self._cable.to_device, self._cable.hub.now_s
        frames: list[tuple[int, bytes]] = []
        while waiting and waiting[0][0] <= now_s:
            frames.append(waiting.popleft()[1])
        return [] if self.bus_off else frames

    def send(self, can_id: int, data: bytes) -> None:
        if not self.bus_off:
            self._put(can_id, bytes(data))

    def send_error(self, classes: int) -> None:
        """Report an error, as the host's own controller would."""
        self._put(classes | ERROR_FLAG, bytes(8))

    def readers(self) -> list[int]:
        return []

    def close(self) -> None:
        self._cable.attached = self._cable.held = False
        self._cable.generation += 1
        self._cable.clear()

    def _put(self, can_id: int, data: bytes) -> None:
        cable = self._cable
        if cable.held and cable.plugged:
            at_s = cable.down.arrives_s(cable.hub.now_s)
            cable.to_host.append((at_s, (can_id, data)))
