"""Corrections at a contact, which need the direction of the surface; standards."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.contact import Contact
from traverse.kinematics.effects.base.correction import ContactCorrection, Correction
from traverse.kinematics.model.quaternion import dot


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeRadius(ContactCorrection):
    """A ball that is larger or smaller than stated.

    effective radius = radius_mm + radius_error_mm

    The material begins one effective radius from the ball's centre. The corrected
    centre is one radius_mm from it: the centre moves towards the material by
    radius_error_mm.
    """

    kind: ClassVar[str] = "probe_radius"

    def derivatives(self, contact: Contact) -> Floats:
        """Towards the material, (1, 3, n_samples)."""
        return contact.directions[None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeLobing(ContactCorrection):
    """Pretravel of a switching probe with three seats.

    pretravel = amplitude_mm cos(3 psi - phase_rad)

    psi is the azimuth of the direction about the shank, see `contact`. The probe
    switches one pretravel after it touched, so the ball's centre at the touch is that
    much further from the material, along the surface's outward normal. It is the one
    kind whose second value does not enter linearly.
    """

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


@dataclass(frozen=True, slots=True, kw_only=True)
class StylusBending(ContactCorrection):
    """A stylus that bends under the contact force.

    The surface pushes the ball with force_n against the direction d towards the
    material; the ball yields along the part of that force that is across the shank s:

        shift = -compliance_mm_n force_n (d - s (s . d))

    An unknown force is 1 N.
    """

    kind: ClassVar[str] = "stylus_bending"

    def derivatives(self, contact: Contact) -> Floats:
        """The force across the shank in N, (1, 3, n_samples)."""
        directions, shanks = contact.directions, contact.shanks
        across = directions - shanks * dot(shanks, directions)
        return (-contact.force_n * across)[None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArtefactLength(Correction):
    """A standard, by its id in the campaign, that differs from its certified length.

    true length = certified length (1 + 1e-6 error_ppm)

    Off-line only: it corrects no pose.
    """

    artefact: str

    kind: ClassVar[str] = "artefact_length"
