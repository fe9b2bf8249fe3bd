"""The simulator's devices in a world: their cables, clocks and power.

Faults beyond the simulator's own are added around them: a timer that loses time,
encoders that count from the place of power-up, an exchanged device.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.honesty.timeline import Timeline
from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.truth import EncoderSet
from traverse.simulator.devices.canopen.device import CanOpenBus
from traverse.simulator.devices.device import (
    DeviceContext,
    SimulatedDevice,
    make_device,
)
from traverse.simulator.devices.latch_board.device import SimulatedLatchBoard
from traverse.simulator.devices.latch_board.sampler import TickCounter
from traverse.simulator.devices.microscribe.box import State
from traverse.simulator.devices.microscribe.device import (
    MOST_COUNTS,
    SimulatedMicroscribe,
)
from traverse.simulator.devices.table import DeviceTable
from traverse.simulator.devices.text_line import SimulatedTextLine
from traverse.simulator.devices.wrong_clock import WrongClock
from traverse.simulator.scenario.course import ClimateTable, Course
from traverse.simulator.scenario.faults import Fault
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptClock
from traverse.simulator.virtual_arm import encoders_of


@dataclass(frozen=True, slots=True)
class Freeze:
    """Channels repeat the counts of ``from_s`` until a true time."""

    channels: tuple[int, ...]
    from_s: float
    until_s: float


@dataclass(eq=False)
class MountedCounts:
    """Counts of encoders that may be mounted elsewhere, or count from elsewhere.

    Attributes:
        offsets: (n_channels,) added counts; 0 if the arm file is right.
        freeze: of some; None: all follow their joints.
    """

    course: Course
    encoders: EncoderSet
    offsets: Integers
    freeze: Freeze | None = None

    def __post_init__(self) -> None:
        self._kept_s, self._kept_rad = -1.0, np.zeros((1, 1))

    def counts(self, script_s: Floats, noise: np.random.Generator) -> Integers:
        readings_rad = self._kept_rad
        if len(script_s) > 1 or script_s[0] != self._kept_s:
            readings_rad = self.course.readings_rad(script_s)
            if len(script_s) == 1:
                self._kept_s, self._kept_rad = float(script_s[0]), readings_rad
        counts = self.encoders.counts(readings_rad, noise)
        if freeze := self.freeze:
            rows = (freeze.from_s <= script_s) & (script_s < freeze.until_s)
            columns = np.isin(np.arange(counts.shape[1]), freeze.channels)
            counts[np.ix_(rows, columns)] = self._counts_at(freeze.from_s)[columns]
        return (counts + self.offsets) % self.encoders.moduli

    def count_from_zero(self, true_s: float) -> None:
        """Power incremental encoders up: they begin at 0 in any place."""
        self.offsets = -self._counts_at(true_s)

    def _counts_at(self, true_s: float) -> Integers:
        readings_rad = self.course.readings_rad(np.array([max(true_s, 0.0)]))
        counts: Integers = self.encoders.counts(readings_rad, np.random.default_rng(0))
        return counts[0]

    def mount_elsewhere(self, turns: Sequence[float]) -> None:
        """Replace the encoders, with other zeros."""
        per_turn = self.encoders.counts_per_turn
        self.offsets = np.rint(np.asarray(turns) * per_turn).astype(np.int64)

    @property
    def is_right(self) -> bool:
        """The encoders have the arm file's zeros."""
        return not (self.offsets % self.encoders.counts_per_turn).any()


class WorldTicks(TickCounter):
    """The counter of a board whose clock follows a timeline."""

    timeline: Timeline
    _begin_s: float

    def __init__(self, rate_hz: int, power_up_s: float, timeline: Timeline) -> None:
        super().__init__(rate_hz, WrongClock(), 0, power_up_s)
        object.__setattr__(self, "timeline", timeline)
        object.__setattr__(self, "_begin_s", timeline.at(power_up_s))

    def at(self, time_s: float) -> int:
        passed_s = self.timeline.at(time_s) - self._begin_s
        return int(np.floor(passed_s * self.rate_hz + 1e-5))

    def time_s(self, ticks: int) -> float:
        begin_s: float = self._begin_s
        return self.timeline.true(begin_s + ticks / self.rate_hz)

    def times_s(self, ticks: Integers) -> Floats:
        begin_s: float = self._begin_s
        return self.timeline.true_array(begin_s + ticks / self.rate_hz)


class WorldBoard(SimulatedLatchBoard):
    """A latch board with the clock of a world."""

    timeline = Timeline()

    def switch_on(self, now_s: float) -> None:
        super().switch_on(now_s)
        self.use_timeline(self.timeline, now_s)

    def use_timeline(self, timeline: Timeline, power_up_s: float = 0.0) -> None:
        """Count by another clock."""
        self.timeline = timeline
        ticks = WorldTicks(self._table.tick_rate_hz, power_up_s, timeline)
        self.board._ticks = self.board.alarms._ticks = ticks
        self.board.sampler._ticks = ticks


class WorldTextLine(SimulatedTextLine):
    """A board that prints by the clock of a world."""

    timeline = Timeline()

    def power_up(self, now_s: float) -> None:
        super().power_up(now_s)
        self._true_power_up_s = now_s

    def _line(self, at_s: float) -> bytes:
        shown_s = self.timeline.at(at_s) - self.timeline.at(self._true_power_up_s)
        self._power_up_s = at_s - shown_s
        return super()._line(at_s)

    def advance(self, to_s: float) -> None:
        """Print the due lines, at periods of its own clock."""
        while self._next_s <= to_s:
            at_s = self._next_s
            shown_s = self.timeline.at(at_s) + self._period_s
            self._next_s = max(at_s + 1e-4, self.timeline.true(shown_s))
            self.say(0, self._line(at_s), at_s)
        super().advance(to_s)


class WorldMicroscribe(SimulatedMicroscribe):
    """A MicroScribe whose timer follows a world."""

    timeline = Timeline()

    def _state_at(self, at_s: float, command: int) -> State:
        state = super()._state_at(at_s, command)
        passed_s = self.timeline.at(at_s) - self.timeline.at(self._power_up_s)
        ticks = self._first_ticks + int(passed_s * self._tick_rate_hz)
        return replace(state, ticks=ticks % MOST_COUNTS)


CLASSES: dict[str, type[SimulatedDevice]] = {
    "latch-board": WorldBoard,
    "text-line": WorldTextLine,
    "microscribe": WorldMicroscribe,
    "canopen": CanOpenBus,
}


@dataclass(eq=False)
class MountedDevice:
    """A device of a world, on the arm.

    Attributes:
        is_own: It is the one that the operator has confirmed.
    """

    table: DeviceTable
    device: SimulatedDevice
    source: MountedCounts
    timeline: Timeline
    is_own: bool = True

    def exchange(self, number: int, turns: Sequence[float]) -> None:
        """Replace the device by another of its kind, with zeros of its own."""
        seed = (self.device.mounting.seed[0] + number, self.device.mounting.seed[1])
        self.device.mounting = replace(self.device.mounting, seed=seed)
        self.source.mount_elsewhere(turns)
        self.is_own = False
        if isinstance(self.device, CanOpenBus):
            for encoder in self.device._encoders:
                encoder.data = replace(
                    encoder.data, serial=encoder.data.serial + number
                )


def mount(
    table: DeviceTable,
    arm: Arm,
    course: Course,
    script: Script,
    *,
    timeline: Timeline,
    faults: tuple[Fault, ...],
    seed: tuple[int, int],
    clock: ScriptClock,
) -> MountedDevice:
    """Make a device and put it on the arm; its ports are patched in."""
    encoders = encoders_of(table, arm, 0.0)
    source = MountedCounts(course, encoders, np.zeros(len(encoders.joints), np.int64))
    context = DeviceContext(
        Path("/"),
        encoders,
        source,
        script,
        clock,
        faults,
        seed,
        TruthLog(None, course, clock),
        ClimateTable(),
    )
    kind = CLASSES.get(table.kind)
    device = make_device(table, context) if kind is None else kind(table, context)
    if isinstance(device, WorldBoard):
        device.use_timeline(timeline)
    elif isinstance(device, WorldTextLine | WorldMicroscribe):
        device.timeline = timeline
    return MountedDevice(table, device, source, timeline)
