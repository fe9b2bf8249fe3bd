"""The interface between the simulator's loop and a device.

Devices are made as `Class(table, mounting)`; an `OSError` from there is reported as a
mistake of the device's table. Everything happens in one thread: the loop waits until
a descriptor is ready or `next_due_s` is reached and then calls `live` of every device
with the time of the simulation, which never runs backwards.
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
    """What a device receives besides its table.

    Attributes:
        folder: Paths of its table are relative to it.
        encoders: Wired to it, by channel.
        source: Of their counts.
        script: What happens to its inputs.
        clock: When the script begins; a device calls `clock.begin(time_s)` with its
            first reading.
        faults: That concern it and that its kind plays.
        seed: Of everything that this device draws.
        notes: Of what it does.
        climate: What its temperature sensors feel.
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
        """How many encoders it has."""
        return len(self.encoders.joints)

    @property
    def line_faults(self) -> tuple[Fault, ...]:
        """Those of the line and of the device itself."""
        return tuple(f for f in self.faults if not isinstance(f, EncoderFault))

    def wiring(
        self, inputs: Sequence[str], n_power_ups: int, from_s: float = 0.0
    ) -> Wiring:
        """Wire the encoders and inputs up, anew at each power-up.

        Each power-up, counted from 1, has noise of its own; changes before
        ``from_s`` are not reported.
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
        """Whether a fault "gone" has removed the device."""
        if self.clock.begin_s is None:
            return False
        return self.struck("gone", now_s)

    def struck(self, kind: str, at_s: float, channel: int | None = None) -> bool:
        """Whether a fault of a kind lasts, for a channel or the device as a whole."""
        script_s = self.clock.script_s(at_s)
        return any(f.kind == kind and f.strikes(script_s, channel) for f in self.faults)


class SimulatedDevice(ABC):
    """A device of whatever kind, which faults take away and bring back.

    Attributes:
        id: Of its table.
        where: Where hosts find it, printed in its line "ready <id> <where>".
        mounting: What it is connected to.
        disturbed: Plays the faults of its line.
        wiring: Of its encoders and inputs since the last power-up.
        n_power_ups: So often it was switched on.
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
        """It has power, and hosts find it."""

    @property
    def streaming(self) -> bool:
        """It sends samples by itself; fast time may run ahead."""
        return False

    @property
    def ahead(self) -> bool:
        """The host is still busy with what it was sent; fast time waits."""
        return False

    @abstractmethod
    def live(self, now_s: float) -> None:
        """Do all that is due until now, and answer the host."""

    @abstractmethod
    def next_due_s(self, block_s: float) -> float:
        """When to call `live` next; samples of a stream may be gathered so long."""

    @abstractmethod
    def readers(self) -> list[int]:
        """Descriptors to wait for until they can be read."""

    @abstractmethod
    def writers(self) -> list[int]:
        """Descriptors to wait for until they can be written."""

    @abstractmethod
    def close(self) -> None:
        """Take away what hosts find; may be called again."""

    def switch_on(self, now_s: float) -> None:
        """Get power; a child also makes what hosts find.

        Raises:
            OSError: That cannot be made.
        """
        self.n_power_ups += 1
        self.wiring = self.mounting.wiring(self._inputs, self.n_power_ups, now_s)

    def is_there(self, now_s: float) -> bool:
        """Disappear and return by the faults; whether it is there now."""
        away = self.mounting.away(now_s)
        if away and self.is_on:
            self.close()
        elif not away and not self.is_on:
            self.switch_on(now_s)
        return not away

    def totals(self) -> dict[str, Any]:
        """Final counters over all power-ups, for the last line of the truth log."""
        counts = asdict(self.disturbed.counts)
        return {"power_ups": self.n_power_ups, "faults": counts}


def make_device(table: DeviceTable, mounting: DeviceContext) -> SimulatedDevice:
    """Make a device of the kind of its table.

    Raises:
        OSError: Its port cannot be made.
    """
    device: SimulatedDevice = class_named(KINDS[table.kind].device)(table, mounting)
    return device
