"""Wiring of one board: encoders on the virtual arm, buttons, their faults."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers
from traverse.simulator.arm.truth import EncoderSet
from traverse.simulator.scenario.course import Course
from traverse.simulator.scenario.faults import (
    EncoderFault,
    JumpFault,
    StatusFault,
    UnreadFault,
)
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.signals import AlarmChange, InputChange


class CountSource(Protocol):
    """Source of counts."""

    def counts(self, script_s: Floats, noise: np.random.Generator) -> Integers:
        """Counts (n, n_channels) at times (n,) of the script."""


@dataclass(frozen=True, slots=True)
class ScriptedCounts:
    """Counts of encoders on an arm that follows a course."""

    course: Course
    encoders: EncoderSet

    def counts(self, script_s: Floats, noise: np.random.Generator) -> Integers:
        return self.encoders.counts(self.course.readings_rad(script_s), noise)


@dataclass(slots=True)
class ScriptClock:
    """Begin of the script; the arm rests at its start before.

    Attributes:
        begin_s: simulated time; None until the script begins.
    """

    begin_s: float | None = None

    def begin(self, time_s: float) -> None:
        if self.begin_s is None:
            self.begin_s = time_s

    def script_s(self, time_s: float) -> float:
        return 0.0 if self.begin_s is None else max(0.0, time_s - self.begin_s)


class FailingReads:
    """Reads of one encoder that fail now and then: the board keeps the count before.

    Attributes:
        failed_s: of each read that failed, times of the script: of the last one before
            that did not, and its own.
    """

    def __init__(self, fault: UnreadFault, seed: int) -> None:
        self._fault = fault
        self._draw = np.random.default_rng([seed, fault.seed, fault.channel])
        self._last_s = self._good_s = -1.0
        self._kept = self._left = 0
        self._may_fail = True
        self.failed_s: list[tuple[float, float]] = []

    def spoil(self, script_s: Floats, counts: Integers) -> None:
        """Replace what was not read in counts (n, n_channels), in place."""
        column = counts[:, self._fault.channel]
        for row, time_s in enumerate(script_s.tolist()):
            if time_s > self._last_s:
                self._read(time_s, int(column[row]))
            if time_s == self._last_s:  # also once more for another channel
                column[row] = self._kept

    def _read(self, time_s: float, count: int) -> None:
        fault, self._last_s = self._fault, time_s
        if self._may_fail and self._draw.random() < fault.probability:
            self._left = int(self._draw.integers(1, fault.most + 1))
        if not self._left or self._good_s < 0.0 or not fault.lasts(time_s):
            self._left, self._good_s, self._kept = 0, time_s, count
            self._may_fail = True
            return
        self._left, self._may_fail = self._left - 1, False
        self.failed_s.append((self._good_s, time_s))


class Wiring:
    """Latched channels and inputs of one board.

    Moduli have shape (n_channels,); changes before ``from_script_s``, the power-up, are
    not reported.

    Attributes:
        failing_reads: of each fault of this kind.
    """

    def __init__(
        self,
        source: CountSource,
        script: Script,
        clock: ScriptClock,
        *,
        inputs: Sequence[str],
        faults: Sequence[EncoderFault],
        moduli: Integers,
        seed: Sequence[int],
        from_script_s: float = 0.0,
    ) -> None:
        self._source = source
        self._script = script
        self._clock = clock
        self._inputs = list(inputs)
        self.failing_reads = [
            FailingReads(fault, seed[0])
            for fault in faults
            if isinstance(fault, UnreadFault)
        ]
        self._faults = [it for it in faults if not isinstance(it, UnreadFault)]
        self._moduli = moduli
        self._noise = np.random.default_rng([*seed, 1])
        self._edge_noise = np.random.default_rng([*seed, 2])
        self._next_event = 0
        self._alarms = sorted(_alarm_changes(faults), key=lambda a: a.time_s)
        while (change := self._next()) is not None and change.time_s < from_script_s:
            self.take_change()

    def latch(
        self, times_s: Floats, edge: bool
    ) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
        """Return counts and status (n, n_channels) at times (n,)."""
        begin_s = self._clock.begin_s
        script_s = np.maximum(
            0.0, times_s - (times_s[-1] if begin_s is None else begin_s)
        )
        noise = self._edge_noise if edge else self._noise
        counts = self._source.counts(script_s, noise)
        status = np.zeros(counts.shape, dtype=np.uint8)
        for fault in self._faults:
            ends_s = fault.at_s + fault.duration_s
            struck = (script_s >= fault.at_s) & (script_s < ends_s)
            if np.any(struck):
                self._spoil(fault, struck, counts, status)
        for failing in self.failing_reads:
            failing.spoil(script_s, counts)
        return counts.astype(np.uint32), status

    def peek_change(self) -> InputChange | AlarmChange | None:
        begin_s = self._clock.begin_s
        change = None if begin_s is None else self._next()
        if begin_s is None or change is None:
            return None
        return replace(change, time_s=begin_s + change.time_s)

    def take_change(self) -> None:
        if isinstance(self._next(), AlarmChange):
            self._alarms.pop(0)
        else:
            self._next_event += 1

    def _next(self) -> InputChange | AlarmChange | None:
        change = self._next_of_inputs()
        if self._alarms and (change is None or self._alarms[0].time_s <= change.time_s):
            return self._alarms[0]
        return change

    def _next_of_inputs(self) -> InputChange | None:
        names = {event.input_name for event in self._script.events}
        if names.isdisjoint(self._inputs):
            return None
        while entry := self._script.event(self._next_event):
            time_s, event = entry
            if event.input_name in self._inputs:
                number = self._inputs.index(event.input_name)
                return InputChange(time_s, number, event.level, event)
            self._next_event += 1
        return None

    def _spoil(
        self,
        fault: EncoderFault,
        struck: Booleans,
        counts: Integers,
        status: NDArray[np.uint8],
    ) -> None:
        channel = fault.channel
        if isinstance(fault, JumpFault):
            jumped = counts[struck, channel] + fault.step_counts
            counts[struck, channel] = jumped % self._moduli[channel]
        elif isinstance(fault, StatusFault):
            status[struck, channel] |= fault.bits
        else:
            start_s = np.array([fault.at_s])
            quiet = np.random.default_rng(0)
            counts[struck, channel] = self._source.counts(start_s, quiet)[0, channel]


def _alarm_changes(faults: Sequence[EncoderFault]) -> list[AlarmChange]:
    return [
        AlarmChange(time_s, fault.channel, state, fault.code, fault.value)
        for fault in faults
        if isinstance(fault, StatusFault)
        for time_s, state in ((fault.at_s, 1), (fault.at_s + fault.duration_s, 0))
    ]
