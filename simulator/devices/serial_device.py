"""Devices on ptys that answer requests byte by byte.

A subclass defines the meaning of a byte (`receive_byte`), its own actions (`advance`,
`own_due_s`), and its loss of state without power (`power_up`). It reads its encoders
with `latch` and answers with `say`; faults of the line, of the power and of single
encoders are played here.
"""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.simulator.devices.device import DeviceContext, SimulatedDevice
from traverse.simulator.devices.serial_line import SerialLine
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.scenario.signals import InputChange, LatchedEdge


def checked_addresses(
    addresses: tuple[int, ...], valid: range, expected: str
) -> tuple[int, ...]:
    """Return addresses.

    Raises:
        ValueError: one is invalid, or given twice.
    """
    for address in addresses:
        if address not in valid:
            raise ValueError(f"{address} is no address; expected {expected}")
        if addresses.count(address) > 1:
            raise ValueError(f"{address} is given twice")
    return addresses


class SerialDevice(SimulatedDevice):
    """A device on one or more lines."""

    def __init__(
        self,
        table: SerialTable,
        mounting: DeviceContext,
        ports: Sequence[str],
        inputs: Sequence[str] | None = None,
        bits_per_byte: int = 10,
    ) -> None:
        super().__init__(table, mounting, inputs or ())
        self.n_readings = 0
        self.n_rejected = 0
        self._paths: list[Path] = [mounting.folder / port for port in ports]
        self.where = " ".join(map(str, self._paths))
        self._serial, self._bits_per_byte = table, bits_per_byte
        self._has_inputs = inputs is not None
        self.levels = self._n_edges = 0
        self._lines: list[SerialLine] = []
        self._n_dropped = 0
        self.switch_on(0.0)

    @abstractmethod
    def power_up(self, now_s: float) -> None:
        """Reset as after power-up."""

    @abstractmethod
    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        """Process a byte of a line, whose last bit arrived at an instant."""

    def advance(self, to_s: float) -> None:
        """Do all that is due until an instant, in order of time."""
        del to_s  # most devices speak when they are spoken to

    def own_due_s(self) -> float:
        """Return when `advance` has something to do; infinity for never."""
        return float("inf")

    def lose_host(self, line: int) -> None:
        """Drop unfinished requests: the host opened or closed the line."""
        del line  # most devices have nothing to drop

    @property
    def is_on(self) -> bool:
        return bool(self._lines)

    def latch(self, channel: int, at_s: float) -> tuple[int, int]:
        """Read an encoder at an instant: its count, and status bits of a board."""
        self.mounting.clock.begin(at_s)
        counts, status = self.wiring.latch(np.array([at_s]), edge=False)
        count, flags = int(counts[0, channel]), int(status[0, channel])
        self.n_readings += 1
        self.mounting.notes.reading(self.id, channel, at_s, count, flags)
        return count, flags

    def say(
        self, line: int, data: bytes, at_s: float, channel: int | None = None
    ) -> None:
        """Answer a request that ended at an instant, as faults allow.

        No channel means the whole device.
        """
        script_s = self.mounting.clock.script_s(at_s)
        leaves_s = (
            at_s + self._serial.turnaround_s + self.disturbed.delay_s(script_s, channel)
        )
        data = self.disturbed.disturb(data, script_s, channel)
        if data:
            self._lines[line].say(data, leaves_s)

    def report_edges(
        self,
        at_s: float,
        ticks: int,
        counts: NDArray[np.uint32],
        status: NDArray[np.uint8],
    ) -> None:
        """Note changes of inputs until an instant, with the first reading of each."""
        while (change := self.wiring.peek_change()) and change.time_s <= at_s:
            self.wiring.take_change()
            if not isinstance(change, InputChange):
                continue
            number, level = change.input_number, change.level
            self.levels = self.levels & ~(1 << number) | level << number
            latched = ticks, counts, status
            edge = LatchedEdge(at_s, number, level, self.levels, *latched, change.event)
            self.mounting.notes.edge(self.id, self._n_edges, edge)
            self._n_edges += 1

    @property
    def ahead(self) -> bool:
        return bool(self.writers())

    def readers(self) -> list[int]:
        return [number for line in self._lines for number in line.port.readers()]

    def writers(self) -> list[int]:
        return [number for line in self._lines for number in line.port.writers()]

    def live(self, now_s: float) -> None:
        """Receive, process and answer all that is due, in order of time."""
        if not self.is_there(now_s):
            return
        for number, line in enumerate(self._lines):
            if line.listen(now_s):
                self.lose_host(number)
        received = [
            (at_s, number, byte)
            for number, line in enumerate(self._lines)
            for at_s, byte in line.arrived_by(now_s)
        ]
        for at_s, number, byte in sorted(received, key=lambda entry: entry[0]):
            self.advance(at_s)
            self.receive_byte(number, byte, at_s)
        self.advance(now_s)
        for line in self._lines:
            line.release(now_s)

    def next_due_s(self, block_s: float) -> float:
        del block_s  # nothing is gathered: a host waits for each answer
        if not self._lines:
            return float("inf")
        due_s = min(line.next_due_s() for line in self._lines)
        return min(due_s, self.own_due_s())

    def totals(self) -> dict[str, Any]:
        n_dropped = self._n_dropped + sum(line.n_dropped for line in self._lines)
        return {
            "samples": self.n_readings,
            "tx_dropped": n_dropped,
            "rx_rejected": self.n_rejected,
            **super().totals(),
            **({"edges": self._n_edges} if self._has_inputs else {}),
        }

    def close(self) -> None:
        for line in self._lines:
            self._n_dropped += line.n_dropped
            line.port.close()
        self._lines = []

    def switch_on(self, now_s: float) -> None:
        super().switch_on(now_s)
        try:
            for path in self._paths:
                self._lines.append(SerialLine(path, self._serial, self._bits_per_byte))
        except OSError:
            self.close()
            raise
        self.power_up(now_s)
