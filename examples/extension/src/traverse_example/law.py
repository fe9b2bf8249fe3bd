"""The simulator's law of the half wave: written for itself, not by the correction."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import EffectEntry, JointState, ReadingFault


@dataclass(frozen=True, slots=True)
class HalfWaveFault(ReadingFault):
    """A ring that turns half as fast as the joint, and is not centred."""

    size_rad: float
    phase_rad: float

    def errors_rad(self, state: JointState) -> Floats:
        ring_rad = 0.5 * state.readings_rad[:, self.joints]
        errors: Floats = self.size_rad * np.cos(ring_rad - self.phase_rad)
        return errors


def half_wave(entry: EffectEntry) -> HalfWaveFault:
    """Make the fault of an entry of `[[effects]]`."""
    size_rad = float(np.hypot(entry["cos_rad"], entry["sin_rad"]))
    phase_rad = float(np.arctan2(entry["sin_rad"], entry["cos_rad"]))
    return HalfWaveFault(entry.joints, size_rad, phase_rad)
