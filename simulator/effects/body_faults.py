"""Parts of the arm that yield to weight, warmth and time, and bearings that wander."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import BodyFault
from traverse.simulator.effects.posture import Deflection, Posture


@dataclass(frozen=True, slots=True)
class SoftJoint(BodyFault):
    """The shaft between the encoder and the element twists under the weights."""

    joint: int
    compliance_rad_nm: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Twist about the axis, down with the weights."""
        torques_nm = np.einsum(
            "ni,ni->n", posture.moments_nm[:, self.joint], posture.axis(self.joint)
        )
        yielding.twists_rad[:, self.joint] += self.compliance_rad_nm * torques_nm


@dataclass(frozen=True, slots=True)
class SoftBearing(BodyFault):
    """The axis tilts under the weights."""

    joint: int
    compliance_rad_nm: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Tilt by the part of the moment across the axis."""
        across_nm = _across(posture.moments_nm[:, self.joint], posture.axis(self.joint))
        tilts = self.compliance_rad_nm * across_nm
        yielding.tilts_rad[self.joint] += posture.in_carrier(tilts, self.joint)


@dataclass(frozen=True, slots=True)
class SoftMount(BodyFault):
    """The table tilts under the arm."""

    compliance_rad_nm: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Tilt by the overturning moment; a table does not turn about the vertical."""
        gravity = posture.build.gravity_m_s2
        length = np.linalg.norm(gravity)
        if length > 0.0:
            down = np.broadcast_to(gravity / length, (len(posture.turns_rad), 3))
            across_nm = _across(posture.moments_nm[:, 0], down)
            yielding.base_tilts_rad[...] += self.compliance_rad_nm * across_nm


@dataclass(frozen=True, slots=True)
class WarmElements(BodyFault):
    """Elements grow with the temperature."""

    joints: slice
    expansion_per_c: float
    reference_c: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Grow."""
        warmer_c = posture.around.temperature_c - self.reference_c
        yielding.growths[:, self.joints] += self.expansion_per_c * warmer_c[:, None]


@dataclass(frozen=True, slots=True)
class WanderingAxis(BodyFault):
    """The axis tilts or its origin shifts, so many times a turn.

    Attributes:
        joint: From 0.
        tilts: It tilts [rad], else it shifts [mm].
        order: Periods a turn.
        cos: (3,) in the base posture.
        sin: (3,) likewise.
    """

    joint: int
    tilts: bool
    order: int
    cos: Floats
    sin: Floats

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Follow the true turn; the bearing's raceway is fixed to the carrier."""
        phases = self.order * posture.turns_rad[:, self.joint, None]
        wander = self.cos * np.cos(phases) + self.sin * np.sin(phases)
        whole = yielding.tilts_rad if self.tilts else yielding.shifts_mm
        whole[self.joint] += wander


@dataclass(frozen=True, slots=True)
class CreepingBase(BodyFault):
    """The base creeps continuously."""

    rate_mm_s: Floats
    epoch_utc_s: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Creep."""
        since_s = posture.around.since_s(self.epoch_utc_s)
        yielding.base_shifts_mm[...] += since_s[:, None] * self.rate_mm_s


@dataclass(frozen=True, slots=True)
class KnockedBase(BodyFault):
    """The base is knocked once and stays where it then is."""

    step_mm: Floats
    at_s: float
    epoch_utc_s: float

    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Jump."""
        knocked = posture.around.since_s(self.epoch_utc_s) >= self.at_s
        yielding.base_shifts_mm[...] += knocked[:, None] * self.step_mm


def _across(vectors: Floats, units: Floats) -> Floats:
    """Components of vectors (n, 3) across units (n, 3)."""
    along = np.einsum("ni,ni->n", vectors, units)
    rest: Floats = vectors - along[:, None] * units
    return rest
