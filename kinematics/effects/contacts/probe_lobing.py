"""Pretravel of a switching probe with three seats.

    pretravel = amplitude_mm cos(3 psi - phase_rad)

psi is the azimuth of the direction about the shank, see `contact`. The probe switches
one pretravel after it touched, so the ball's centre at the touch is that much further
from the material, along the surface's outward normal.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.contact import Contact
from traverse.kinematics.effects.contacts.touching import Touching


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeLobing(Touching):
    """Three lobes; the one kind whose second value does not enter linearly."""

    kind: ClassVar[str] = "probe_lobing"

    def derivatives(self, contact: Contact) -> Floats:
        """For the amplitude and for the phase, (2, 3, n_samples)."""
        amplitude_mm, phase_rad = self.values
        cosine, sine = np.cos(phase_rad), np.sin(phase_rad)
        wave = contact.triple_cosine * cosine + contact.triple_sine * sine
        slope = contact.triple_sine * cosine - contact.triple_cosine * sine
        normals = -contact.directions
        return np.stack([normals * wave, normals * (amplitude_mm * slope)])

    def amount(self, contact: Contact) -> Floats:
        """Along the outward normal, (3, n_samples)."""
        by_amplitude: Floats = self.derivatives(contact)[0]
        return self.values[0] * by_amplitude
