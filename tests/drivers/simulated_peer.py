"""Peers that are devices of the simulator, alive in a thread."""

from collections.abc import Callable
from pathlib import Path

from traverse.simulator.devices.device import DeviceContext, SimulatedDevice
from traverse.simulator.pacing import MonotonicClock, live_real
from traverse.testing.pty_peer import Peer


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


class SimulatedPeer(Peer):
    """A device of the simulator on ports in its folder, of which ``link`` is one.

    Args:
        link: one of its ports.
        make: makes the device anew each time it is plugged in.
        mounting: of the device.
    """

    def __init__(
        self, link: Path, make: Callable[[], SimulatedDevice], mounting: DeviceContext
    ) -> None:
        super().__init__()
        self.link = link
        self._make, self._mounting = make, mounting

    def _open(self) -> None:
        self.device = self._make()

    def _close(self) -> None:
        self.device.close()

    def _live(self) -> None:
        clock, ended = self._mounting.clock, lambda: not self._plugged
        live_real([self.device], MonotonicClock(), clock, None, ended)
