"""A rig whose device is the simulator's, alive in a thread."""

import threading
from collections.abc import Callable

from traverse.simulator.devices.device import DeviceContext, SimulatedDevice
from traverse.simulator.pacing import MonotonicClock, live_real


class CountsUp:
    """Mixed into a device: its counts rise by one from reading to reading.

    Attributes:
        reading: how replies begin that are lost on demand.
        to_lose: how many more of them, by line.
    """

    reading = b""

    def __init__(self, table, mounting: DeviceContext) -> None:
        self.to_lose = [0, 0]
        self.counts = [0, 0]
        super().__init__(table, mounting)

    def latch(self, channel, at_s):
        self.counts[channel] += 1
        return self.counts[channel], 0

    def say(self, line, data, at_s, channel=None):
        if self.to_lose[line] and data.startswith(self.reading):
            self.to_lose[line] -= 1
        else:
            super().say(line, data, at_s, channel)


class SimulatedRig:
    """Plugged in from the beginning.

    Args:
        make: makes the device anew each time it is plugged in.
        mounting: of the device.
    """

    def __init__(
        self, make: Callable[[], SimulatedDevice], mounting: DeviceContext
    ) -> None:
        self._make, self._mounting = make, mounting
        self._thread: threading.Thread | None = None
        self.plug()

    def emit(self, n: int) -> None:
        """Encoders that answer when polled."""

    def unplug(self) -> None:
        if self._thread is not None:
            self._ended.set()
            self._thread.join()
            self._thread = None
            self.device.close()

    def plug(self) -> None:
        self._ended = threading.Event()
        self.device = self._make()
        life = ([self.device], MonotonicClock(), self._mounting.clock, None)
        self._thread = threading.Thread(
            target=live_real, args=(*life, self._ended.is_set), name="simulated"
        )
        self._thread.start()
