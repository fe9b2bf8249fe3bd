"""The interface between the simulator's loop and a device.

Devices are made as `Class(table, mounting)`; an `OSError` is reported as a mistake of
the device's table. Everything happens in one thread: the loop waits until a descriptor
is ready or `next_due_s` is reached and then calls `live` of every device with the
simulated time, which never runs backwards.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from traverse.simulator.arm.truth import EncoderSet
from traverse.simulator.devices.serial_line import DisturbedLine
from traverse.simulator.devices.table import KINDS, DeviceTable, class_named
from traverse.simulator.scenario.course import ClimateTable
from traverse.simulator.scenario.faults import EncoderFault, Fault
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import CountSource, ScriptClock, Wiring


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """Inputs of a device besides its table.

    Attributes:
        folder: base of relative paths in its table.
        encoders: wired to it, by channel.
        clock: of the script; a device calls `clock.begin(time_s)` with its first
            reading.
        faults: that concern it and that its kind plays.
        seed: of everything that this device draws.
    """

    folder: Path
    encoders: EncoderSet
    source: CountSource
    script: Script
    clock: ScriptClock
    faults: tuple[Fault, ...]
    seed: tuple[int, int]
    notes: TruthLog
    climate: ClimateTable

    @property
    def n_channels(self) -> int:
        return len(self.encoders.joints)

    @property
    def line_faults(self) -> tuple[Fault, ...]:
        return tuple(f for f in self.faults if not isinstance(f, EncoderFault))

    def wiring(
        self, inputs: Sequence[str], n_power_ups: int, from_s: float = 0.0
    ) -> Wiring:
        """Wire encoders and inputs up, at each power-up.

        Each power-up, counted from 1, has noise of its own; changes before ``from_s``
        are not reported.
        """
        return Wiring(
            self.source,
            self.script,
            self.clock,
            inputs=inputs,
            faults=[f for f in self.faults if isinstance(f, EncoderFault)],
            moduli=self.encoders.moduli,
            seed=(*self.seed, n_power_ups),
            from_script_s=self.clock.script_s(from_s),
        )

    def away(self, now_s: float) -> bool:
        """Return whether a fault "gone" has removed the device."""
        if self.clock.begin_s is None:
            return False
        return self.struck("gone", now_s)

    def struck(self, kind: str, at_s: float, channel: int | None = None) -> bool:
        script_s = self.clock.script_s(at_s)
        return any(f.kind == kind and f.strikes(script_s, channel) for f in self.faults)


class SimulatedDevice(ABC):
    """A device of any kind, which faults take away and bring back.

    Attributes:
        where: address for hosts, printed in its line "ready <id> <where>".
        disturbed: plays the faults of its line.
        wiring: of its encoders and inputs since the last power-up.
    """

    where: str
    wiring: Wiring

    def __init__(
        self,
        table: DeviceTable,
        mounting: DeviceContext,
        inputs: Sequence[str] = (),
    ) -> None:
        self.id = table.id
        self.mounting = mounting
        self.disturbed = DisturbedLine(mounting.line_faults, mounting.seed[0])
        self.n_power_ups = 0
        self._inputs = inputs

    @property
    @abstractmethod
    def is_on(self) -> bool:
        """Whether it has power, and hosts find it."""

    @property
    def streaming(self) -> bool:
        """Whether it sends samples by itself; fast time may run ahead."""
        return False

    @property
    def ahead(self) -> bool:
        """Whether the host is still busy with earlier bytes; fast time waits."""
        return False

    @abstractmethod
    def live(self, now_s: float) -> None:
        """Do all that is due until now, and answer the host."""

    @abstractmethod
    def next_due_s(self, block_s: float) -> float:
        """Return when to call `live` next, gathering samples for up to ``block_s``."""

    @abstractmethod
    def readers(self) -> list[int]:
        """Return descriptors to wait for until readable."""

    @abstractmethod
    def writers(self) -> list[int]:
        """Return descriptors to wait for until writable."""

    @abstractmethod
    def close(self) -> None:
        """Release the address; may be called again."""

    def switch_on(self, now_s: float) -> None:
        """Get power; a child also creates the address.

        Raises:
            OSError: that cannot be made.
        """
        self.n_power_ups += 1
        self.wiring = self.mounting.wiring(self._inputs, self.n_power_ups, now_s)

    def is_there(self, now_s: float) -> bool:
        """Disappear and return by the faults; return whether it is there."""
        away = self.mounting.away(now_s)
        if away and self.is_on:
            self.close()
        elif not away and not self.is_on:
            self.switch_on(now_s)
        return not away

    def totals(self) -> dict[str, Any]:
        """Return final counters over all power-ups, for the truth log."""
        counts = asdict(self.disturbed.counts)
        return {"power_ups": self.n_power_ups, "faults": counts}


def make_device(table: DeviceTable, mounting: DeviceContext) -> SimulatedDevice:
    """Make the device of a table.

    Raises:
        OSError: its port cannot be made.
    """
    device: SimulatedDevice = class_named(KINDS[table.kind].device)(table, mounting)
    return device
