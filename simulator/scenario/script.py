"""Script of the virtual arm: its course, and changes of inputs on the way."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.arm.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class ScriptEvent:
    """A press, a release, or a change of the probe's switch.

    Attributes:
        time_s: from the start of the script.
        input_name: "button" or "switch".
        level: 1 active, 0 not.
        artefact: touched one; empty for none.
        surface_mm: touched place, None for a seat.
        normal: of the surface there, outwards.
    """

    time_s: float
    input_name: str
    level: int
    artefact: str = ""
    feature: str = ""
    surface_mm: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Script:
    """A course of the arm, with events in order of time; loops repeat it."""

    trajectory: Trajectory
    events: tuple[ScriptEvent, ...]
    repeat: bool

    @property
    def duration_s(self) -> float:
        return self.trajectory.duration_s

    def turns(self, times_s: Floats) -> Floats:
        """Return turns (n, n_joints) at script times (n,)."""
        return self.trajectory.turns(self._in_loop_s(times_s))

    def speeds(self, times_s: Floats) -> Floats:
        """Return speeds of the turns (n, n_joints) [rad/s]."""
        return self.trajectory.speeds(self._in_loop_s(times_s))

    def senses(self, times_s: Floats) -> Floats:
        """Return signs of the last motion, (n, n_joints): -1, +1, or 0 before any."""
        senses = self.trajectory.senses(self._in_loop_s(times_s))
        if self.repeat:
            is_repeated = (times_s >= self.duration_s)[:, None] & (senses == 0.0)
            senses = np.where(is_repeated, self.trajectory.last_senses, senses)
        return senses

    def _in_loop_s(self, times_s: Floats) -> Floats:
        if self.repeat:
            return np.where(times_s > 0.0, times_s % self.duration_s, 0.0)
        return times_s

    def event(self, number: int) -> tuple[float, ScriptEvent] | None:
        """Return an event by number, counted over all loops, with its script time."""
        if not self.events:
            return None
        loop, index = divmod(number, len(self.events))
        if loop and not self.repeat:
            return None
        event = self.events[index]
        return loop * self.duration_s + event.time_s, event
