"""The stage of motions: a course is put together, piece by piece."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans, Floats
from traverse.simulator.arm.inverse import Reach
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.arm.trajectory import (
    Trajectory,
    move_pieces,
    rest_pieces,
    spline_pieces,
)
from traverse.simulator.scenario.script import ScriptEvent
from traverse.strict_toml.reader import StrictModel

IsClear = Callable[[Floats, float], Booleans]
N_DETOURS = 40
N_ACCELERATIONS = 20  # of a piece, that are looked at


class Operator(StrictModel):
    """How the arm is led.

    Attributes:
        move_s: from one target to the next, unless `acceleration_rad_s2` forbids it.
        acceleration_rad_s2: of a joint on that way, at most; a hand's by default.
        approach_s: from the clearance to the contact.
        dwell_s: in contact, besides the press.
        press_s: duration of a press.
        clearance_mm: begin of an approach.
        switch_speed_mm_s: of a switching probe at the contact.
        overtravel_mm: of a switching probe beyond the contact.
        tilt_rad: greatest angle of the shank to the normal.
    """

    move_s: float = Field(default=0.8, gt=0.0)
    acceleration_rad_s2: float = Field(default=50.0, gt=0.0)
    approach_s: float = Field(default=0.4, gt=0.0)
    dwell_s: float = Field(default=0.3, gt=0.0)
    press_s: float = Field(default=0.1, gt=0.0)
    clearance_mm: float = Field(default=15.0, gt=0.0)
    switch_speed_mm_s: float = Field(default=10.0, gt=0.0)
    overtravel_mm: float = Field(default=1.0, gt=0.0)
    tilt_rad: float = Field(default=1.2, gt=0.0, le=3.2)


class UnreachableError(ValueError):
    """Targets of a motion that the arm cannot reach."""


@dataclass(slots=True)
class CourseBuilder:
    """The course so far."""

    reach: Reach
    radius_mm: float
    switching: bool
    operator: Operator
    folder: Path
    posture_rad: Floats
    time_s: float = 0.0
    events: list[ScriptEvent] = field(default_factory=list)
    _ends_s: list[float] = field(default_factory=list)
    _pieces: list[Floats] = field(default_factory=list)

    def trajectory(self) -> Trajectory:
        breaks_s = np.array([0.0, *self._ends_s])
        return Trajectory(breaks_s, np.concatenate(self._pieces))

    def rest(self, duration_s: float) -> None:
        self._append([self.time_s + duration_s], rest_pieces(self.posture_rad))

    def move(self, posture_rad: Floats, duration_s: float) -> None:
        """Go to a posture on the smoothest way of the joints, in as long at least."""
        self._lead(move_pieces(self.posture_rad, posture_rad), duration_s)
        self.posture_rad = posture_rad

    def move_clear(self, posture_rad: Floats, is_clear: IsClear) -> None:
        """Go to a posture, by a drawn one if the ball would hit on the way.

        Without a free way the direct one is taken: surfaces are not solid here.
        """
        limits, start_rad = self.reach.limits_rad, self.posture_rad
        duration_s = self.operator.move_s
        if not self._is_free(start_rad, posture_rad, is_clear):
            for _ in range(N_DETOURS):
                bend = self.reach.rng.uniform(-0.8, 0.8, len(start_rad))
                past = np.clip(0.5 * (start_rad + posture_rad) + bend, *limits.T)
                if self._is_free(start_rad, past, is_clear) and self._is_free(
                    past, posture_rad, is_clear
                ):
                    duration_s *= 0.5
                    self.move(past, duration_s)
                    break
        self.move(posture_rad, duration_s)

    def follow(self, postures_rad: Floats, times_s: Floats) -> None:
        """Pass through postures (n, n_joints), the first being the present one.

        Times (n,) count from now, beginning with 0.
        """
        pieces = spline_pieces(times_s, postures_rad)
        self._append([self.time_s + float(t) for t in times_s[1:]], pieces)
        self.posture_rad = postures_rad[-1]

    def lead(self, postures_rad: Floats, duration_s: float) -> None:
        """Pass through postures in equal steps of time, in as long at least."""
        times_s = np.linspace(0.0, 1.0, len(postures_rad))
        self._lead(spline_pieces(times_s, postures_rad), duration_s)
        self.posture_rad = postures_rad[-1]

    def press(self, change: Callable[[float, str, int], ScriptEvent]) -> None:
        """Press and release the button while the arm rests in contact.

        The instant of the press is drawn, so that it falls between samples.
        """
        dwell_s, press_s = self.operator.dwell_s, self.operator.press_s
        pressed_s = self.time_s + dwell_s * float(self.reach.rng.uniform(0.4, 0.6))
        self.events.append(change(pressed_s, "button", 1))
        self.events.append(change(pressed_s + press_s, "button", 0))
        self.rest(dwell_s + press_s)

    def _is_free(self, start_rad: Floats, end_rad: Floats, is_clear: IsClear) -> bool:
        between = np.linspace(0.0, 1.0, 16)[1:-1, None]
        turns_rad = start_rad + between * (end_rad - start_rad)
        places_mm, _ = probe_pose(self.reach.mechanism, turns_rad)
        return bool(np.all(is_clear(places_mm, self.radius_mm)))

    def _lead(self, pieces: Floats, duration_s: float) -> None:
        """Append pieces of equal durations, no quicker than the operator leads."""
        u = np.linspace(0.0, 1.0, N_ACCELERATIONS)
        powers = np.arange(2, pieces.shape[1])
        weights = powers * (powers - 1) * u[:, None] ** (powers - 2)
        fastest = float(np.abs(np.einsum("up,npj->unj", weights, pieces[:, 2:])).max())
        limit_rad_s2 = self.operator.acceleration_rad_s2
        quickest_s = len(pieces) * (fastest / limit_rad_s2) ** 0.5
        duration_s = max(duration_s, quickest_s)
        ends_s = self.time_s + duration_s * np.arange(1, len(pieces) + 1) / len(pieces)
        self._append(ends_s.tolist(), pieces)

    def _append(self, ends_s: list[float], pieces: Floats) -> None:
        self._ends_s += ends_s
        self._pieces.append(pieces)
        self.time_s = ends_s[-1]
