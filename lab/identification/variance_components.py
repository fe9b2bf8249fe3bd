"""Variance components: how noisy encoders and contacts are, from the residuals.

Foerstner's estimator: a group's variance is the sum of squares of its residuals over
its share of the redundancy; repeated with the new variances until nothing changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lab.campaign import Campaign
from lab.identification.noise import Noise
from lab.identification.pose_statistics import VarianceSums

Floats = NDArray[np.float64]

EncoderGroups = Literal["held", "pooled", "each"]
ContactGroups = Literal["held", "pooled", "by_kind"]

# A group with less redundancy than this says too little about itself.
_LEAST_REDUNDANCY = 5.0
_LARGEST_FACTOR = 100.0


@dataclass(frozen=True, slots=True)
class VarianceModel:
    """Which standard deviations are estimated.

    Attributes:
        encoders: None, one for all joints, or one a joint.
        contacts: None, one for all artefacts, or one a kind.
    """

    encoders: EncoderGroups
    contacts: ContactGroups

    @property
    def estimates(self) -> bool:
        """Whether there is anything to estimate."""
        return self.encoders != "held" or self.contacts != "held"


def variance_model(campaign: Campaign) -> VarianceModel:
    """Estimate what the campaign does not give."""
    return VarianceModel(
        "pooled" if campaign.encoder_rad is None else "held",
        "by_kind" if campaign.contact_mm is None else "held",
    )


def better_noise(
    campaign: Campaign, noise: Noise, sums: VarianceSums, model: VarianceModel
) -> tuple[Noise, float]:
    """Improve the standard deviations once.

    Returns:
        The noise, and the largest relative change of a standard deviation.
    """
    n_joints = len(noise.encoder_rad)
    joints: dict[str, Sequence[int]] = {
        "held": [0] * n_joints,
        "pooled": [0] * n_joints,
        "each": range(n_joints),
    }
    kinds = [artefact.kind for artefact in campaign.artefacts]
    artefacts: dict[str, Sequence[int]] = {
        "held": [0] * len(kinds),
        "pooled": [0] * len(kinds),
        "by_kind": [kinds.index(kind) for kind in kinds],
    }
    encoder = _factors(
        sums.encoder_squares,
        sums.encoder_redundancies,
        joints[model.encoders],
        held=model.encoders == "held",
    )
    contact = _factors(
        sums.contact_squares,
        sums.contact_redundancies,
        artefacts[model.contacts],
        held=model.contacts == "held",
    )
    change = float(np.max(np.abs(np.concatenate([encoder, contact]) - 1.0)))
    return noise.scaled(encoder, contact), change


def _factors(
    squares: Floats, redundancies: Floats, groups: Sequence[int], *, held: bool
) -> Floats:
    """Compute factors of standard deviations, one an entry."""
    factors = np.ones(len(squares))
    if held:
        return factors
    members = np.asarray(groups)
    for group in np.unique(members):
        mine = members == group
        redundancy = float(redundancies[mine].sum())
        if redundancy < _LEAST_REDUNDANCY:
            continue
        ratio = float(np.sqrt(squares[mine].sum() / redundancy))
        factors[mine] = np.clip(ratio, 1.0 / _LARGEST_FACTOR, _LARGEST_FACTOR)
    return factors
