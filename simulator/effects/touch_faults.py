"""Balls of another size, switches with a travel of their own, styli that bend.

In a seat, where there is no single direction of contact, they do nothing: what they
would do there is one constant for a seat, or unknown.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import Touch, TouchFault


@dataclass(frozen=True, slots=True)
class LargerBall(TouchFault):
    """The ball is larger than its certificate states."""

    radius_error_mm: float

    def offsets_mm(self, touch: Touch) -> Floats:
        """Its centre stays further off the material."""
        return -self.radius_error_mm * touch.towards


@dataclass(frozen=True, slots=True)
class ThreeSeats(TouchFault):
    """The switch opens after a travel that depends on the side.

    Three seats carry the stylus; it tips over one of them or over two.
    """

    amplitude_mm: float
    phase_rad: float

    def offsets_mm(self, touch: Touch) -> Floats:
        """The arm moves on towards the material until the switch opens."""
        own = np.einsum("nij,ni->nj", touch.motion[:, :3, :3], touch.towards)
        first, second = azimuth_axes(touch.build.mechanism.shank)
        azimuths = np.arctan2(own @ second, own @ first)
        travels_mm = self.amplitude_mm * np.cos(3.0 * azimuths - self.phase_rad)
        offsets_mm: Floats = travels_mm[:, None] * touch.towards
        return offsets_mm


@dataclass(frozen=True, slots=True)
class SoftStylus(TouchFault):
    """The stylus bends under the contact force."""

    compliance_mm_n: float

    def offsets_mm(self, touch: Touch) -> Floats:
        """The material holds the ball back, so the arm's end moves farther."""
        shanks = touch.motion[:, :3, :3] @ touch.build.mechanism.shank
        along = np.einsum("ni,ni->n", touch.towards, shanks)
        across = touch.towards - along[:, None] * shanks
        bent_mm: Floats = self.compliance_mm_n * touch.force_n[:, None] * across
        return bent_mm


def azimuth_axes(shank: Floats) -> tuple[Floats, Floats]:
    """From where azimuths about the shank count, and a right angle further on.

    In the base posture: the coordinate axis that is most across the shank, made
    perpendicular to it.
    """
    most_across = np.eye(3)[np.argmin(np.abs(shank))]
    second = np.cross(shank, most_across)
    second /= np.linalg.norm(second)
    return np.cross(second, shank), second
