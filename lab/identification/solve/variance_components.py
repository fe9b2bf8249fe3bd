"""Variance components: how noisy encoders and contacts are, from the residuals.

A group's variance is right when the sum of squares of its residuals, in units of the
noise, equals its share of the redundancy (Foerstner). Steps towards that solve

    sum over j of S_ij theta_j = squares_i,    theta_j the factor of variance j

with S_ij the sum of tr(M C_i M C_j) over poses, its diagonal completed so that
theta = 1 is the solution where squares and redundancies agree. Where a solution is
not positive the ratio of squares and redundancy takes its place.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.network import Noise
from traverse.lab.identification.solve.reliability import VarianceSums

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
    n_joints, kinds = len(noise.encoder_rad), [a.kind for a in campaign.artefacts]
    groups = _groups(n_joints, kinds, model)
    squares = np.concatenate([sums.encoder_squares, sums.contact_squares])
    shares = np.concatenate([sums.encoder_redundancies, sums.contact_redundancies])
    numbers = np.unique(groups[groups >= 0])
    members = (groups[np.newaxis] == numbers[:, np.newaxis]).astype(np.float64)
    kept = members @ shares >= _LEAST_REDUNDANCY
    members = members[kept]
    factors = np.ones(len(groups))
    if len(members):
        theta = _thetas(members, squares, shares, sums.information)
        roots = np.clip(np.sqrt(theta), 1.0 / _LARGEST_FACTOR, _LARGEST_FACTOR)
        grouped = members.sum(axis=0) > 0.0
        factors[grouped] = (roots @ members)[grouped]
    change = float(np.max(np.abs(factors - 1.0)))
    better = Noise(
        noise.encoder_rad * factors[:n_joints], noise.contact_mm * factors[n_joints:]
    )
    return better, change


def _groups(n_joints: int, kinds: list[str], model: VarianceModel) -> Integers:
    """Number the groups of joints and then artefacts; -1: held."""
    joints = {
        "held": [-1] * n_joints,
        "pooled": [0] * n_joints,
        "each": list(range(n_joints)),
    }[model.encoders]
    artefacts = {
        "held": [-1] * len(kinds),
        "pooled": [n_joints] * len(kinds),
        "by_kind": [n_joints + kinds.index(kind) for kind in kinds],
    }[model.contacts]
    return np.array(joints + artefacts, dtype=np.int64)


def _thetas(
    members: Floats, squares: Floats, shares: Floats, information: Floats
) -> Floats:
    """Solve for the factors of the groups' variances, (n_groups,)."""
    wanted, redundancies = members @ squares, members @ shares
    matrix = members @ information @ members.T
    # What is held takes its part of the squares as it is.
    held = members @ information @ (1.0 - members.sum(axis=0))
    rest = redundancies - matrix.sum(axis=1) - held
    solved = np.linalg.lstsq(matrix + np.diag(rest), wanted - held, rcond=1e-6)[0]
    ratios = wanted / redundancies
    positive: Floats = np.where(solved > 0.1 * ratios, solved, ratios)
    return positive
