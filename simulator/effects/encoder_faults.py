"""Encoders that show the wrong angle.

A disc's error belongs to the line under the head, so to what is shown, not to the
true turn: a reading is where both agree.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import JointState, ReadingFault


@dataclass(frozen=True, slots=True)
class WavyDisc(ReadingFault):
    """The disc is eccentric, tilted, oval: so many waves a turn."""

    joints: slice
    order: int
    cos_rad: float
    sin_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A wave of the reading, as one sine with its phase."""
        size = np.hypot(self.cos_rad, self.sin_rad)
        phase = np.arctan2(self.cos_rad, self.sin_rad)
        waves: Floats = size * np.sin(
            self.order * seen.readings_rad[:, self.joints] + phase
        )
        return waves


@dataclass(frozen=True, slots=True)
class ToothedDrive(ReadingFault):
    """Teeth that are not alike: the drive leads and lags with every one."""

    joints: slice
    cycles: float
    cos_rad: float
    sin_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A phasor that turns so many times as fast as what is shown."""
        drive_turns = self.cycles * seen.readings_rad[:, self.joints] / (2.0 * np.pi)
        phasor = np.exp(2j * np.pi * np.mod(drive_turns, 1.0))
        found: Floats = np.real(complex(self.cos_rad, -self.sin_rad) * phasor)
        return found


@dataclass(frozen=True, slots=True)
class LongTape(ReadingFault):
    """A graduation with too many lines a radian."""

    joints: slice
    scale_ppm: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Grows with what is shown since the base posture."""
        shown_rad = (
            seen.readings_rad[:, self.joints] - seen.build.zeros_rad[self.joints]
        )
        return 1e-6 * self.scale_ppm * shown_rad


@dataclass(frozen=True, slots=True)
class WarmHead(ReadingFault):
    """The head moves with the temperature."""

    joints: slice
    rate_rad_c: float
    reference_c: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing at the reference temperature."""
        warmer_c = seen.around.temperature_c - self.reference_c
        return self.rate_rad_c * warmer_c[:, None]


@dataclass(frozen=True, slots=True)
class CreepingZero(ReadingFault):
    """The zero creeps continuously."""

    joints: slice
    rate_rad_s: float
    epoch_utc_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing at the epoch."""
        return self.rate_rad_s * seen.around.since_s(self.epoch_utc_s)[:, None]


@dataclass(frozen=True, slots=True)
class LostCounts(ReadingFault):
    """Counts are lost at a moment and never found again."""

    joints: slice
    step_rad: float
    at_s: float
    epoch_utc_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing before."""
        since_s = seen.around.since_s(self.epoch_utc_s)
        return np.where(since_s >= self.at_s, self.step_rad, 0.0)[:, None]


@dataclass(frozen=True, slots=True)
class LateReading(ReadingFault):
    """What is shown is what the turn was a moment ago."""

    joints: slice
    latency_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A joint that moves forwards is shown too far back."""
        return -self.latency_s * seen.around.speed_rad_s[:, self.joints]


@dataclass(frozen=True, slots=True)
class Play(ReadingFault):
    """The encoder runs ahead of the joint in the sense of the motion."""

    joints: slice
    half_width_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Two-valued."""
        return self.half_width_rad * seen.around.approach[:, self.joints]
