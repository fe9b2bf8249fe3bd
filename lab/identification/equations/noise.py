"""The stochastic model: how well encoders read and how well contacts repeat."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.lab.campaign.campaign import Campaign

DEFAULT_ENCODER_RAD = 5e-6
DEFAULT_CONTACT_MM = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Standard deviations.

    Attributes:
        encoder_rad: Of every joint's reading, (n_joints,).
        contact_mm: Of a contact with every artefact, along each axis, (n_artefacts,).
    """

    encoder_rad: Floats
    contact_mm: Floats

    def scaled(self, encoder: Floats, contact: Floats) -> "Noise":
        """Multiply standard deviations by factors (n_joints,) and (n_artefacts,)."""
        return replace(
            self,
            encoder_rad=self.encoder_rad * encoder,
            contact_mm=self.contact_mm * contact,
        )


def a_priori_noise(campaign: Campaign) -> Noise:
    """Take the campaign's noise, or usual figures where it has none."""
    encoder_rad = campaign.encoder_rad or DEFAULT_ENCODER_RAD
    contact_mm = campaign.contact_mm or DEFAULT_CONTACT_MM
    return Noise(
        np.full(len(campaign.joint_names), encoder_rad),
        np.full(len(campaign.artefacts), contact_mm),
    )
