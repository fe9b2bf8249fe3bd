"""Encoders that show the wrong angle in ways that no arm file can name.

A diagnosis should name none. Their angles are true ones: reading minus errors.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import JointState, ReadingFault


@dataclass(frozen=True, slots=True)
class Bump(ReadingFault):
    """Damaged lines: a raised cosine over a range of angles, nothing elsewhere."""

    middle_rad: float
    half_width_rad: float
    height_rad: float

    def errors_rad(self, state: JointState) -> Floats:
        off = (_angles_rad(state, self.joints) - self.middle_rad) / self.half_width_rad
        hill = 0.5 * (1.0 + np.cos(np.pi * np.clip(off, -1.0, 1.0)))
        return self.height_rad * hill


@dataclass(frozen=True, slots=True)
class JumpInAngle(ReadingFault):
    """Lines are missing: beyond an angle all readings are off."""

    at_rad: float
    step_rad: float

    def errors_rad(self, state: JointState) -> Floats:
        beyond = _angles_rad(state, self.joints) >= self.at_rad
        return np.where(beyond, self.step_rad, 0.0)


@dataclass(frozen=True, slots=True)
class CubicError(ReadingFault):
    """An error that grows with the third power of the turn from the base posture."""

    rate_per_rad2: float

    def errors_rad(self, state: JointState) -> Floats:
        cubes: Floats = state.turns_rad[:, self.joints] ** 3
        return self.rate_per_rad2 * cubes


@dataclass(frozen=True, slots=True)
class Sawtooth(ReadingFault):
    """A gear or interpolator that creeps and snaps back, several times a turn."""

    teeth: int
    height_rad: float

    def errors_rad(self, state: JointState) -> Floats:
        cycles = self.teeth * _angles_rad(state, self.joints) / (2.0 * np.pi)
        return self.height_rad * (cycles % 1.0 - 0.5)


@dataclass(frozen=True, slots=True)
class CrossCoupling(ReadingFault):
    """One joint's reading follows another joint's angle, for example by a cable.

    Attributes:
        other: joint that it follows.
        order: periods a turn of the other joint.
    """

    other: int
    height_rad: float
    order: int = 1
    phase_rad: float = 0.0

    def errors_rad(self, state: JointState) -> Floats:
        angles_rad = _angles_rad(state, slice(self.other, self.other + 1))
        waves: Floats = np.sin(self.order * angles_rad + self.phase_rad)
        return self.height_rad * waves


@dataclass(frozen=True, slots=True)
class SquareOfTemperature(ReadingFault):
    """An error that grows with the square of the departure from a temperature."""

    rate_rad_c2: float
    reference_c: float = 20.0

    def errors_rad(self, state: JointState) -> Floats:
        warmer_c = state.around.temperature_c - self.reference_c
        squares: Floats = warmer_c[:, None] ** 2
        return self.rate_rad_c2 * squares


def _angles_rad(state: JointState, joints: slice) -> Floats:
    """Return true angles on the disc, (n, n_chosen)."""
    angles: Floats = state.turns_rad[:, joints] + state.build.zeros_rad[joints]
    return angles
