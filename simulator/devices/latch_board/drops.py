"""What a board drops because its transmit buffer is full, and whose fault it was."""

from traverse.simulator.devices.device import DeviceObserver


class DropCounter:
    """Notes each time that samples are dropped, from the first to the last in a row.

    Args:
        device: Whose.
        notes: Where it is written when it is over.
    """

    def __init__(self, device: str, notes: DeviceObserver) -> None:
        self._device, self._notes = device, notes
        self._lived_s = self._stood_s = 0.0
        self._begun_s = self._cause_s = 0.0
        self._n = 0

    def live(self, now_s: float) -> None:
        """The program has reached the board."""
        self._stood_s, self._lived_s = now_s - self._lived_s, now_s

    def count(self, n_dropped: int) -> None:
        """Samples have been sent, so many of them dropped."""
        if n_dropped and not self._n:
            self._begun_s, self._cause_s = self._lived_s, self._stood_s
        self._n += n_dropped
        if not n_dropped:
            self.finish()

    def finish(self) -> None:
        """Write what there is to write."""
        if self._n:
            self._notes.dropped(self._device, self._n, self._begun_s, self._cause_s)
            self._n = 0
