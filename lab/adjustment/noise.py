"""How noisy readings, contacts and orientations are: as stated, assumed, or estimated.

Variance components: a group's variance is right when the sum of squares of its
residuals, in units of the noise, equals its share of the redundancy (Foerstner). Steps
towards that solve

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

DEFAULT_ENCODER_RAD = 5e-6
DEFAULT_CONTACT_MM = 0.005
DEFAULT_ORIENTATION_RAD = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Standard deviations.

    Attributes:
        encoder_rad: Of every joint's reading, (n_joints,).
        contact_mm: Of a contact with every artefact, along each axis, (n_artefacts,).
        orientation_rad: Of a measured orientation, about each axis.
    """

    encoder_rad: Floats
    contact_mm: Floats
    orientation_rad: float = DEFAULT_ORIENTATION_RAD


def a_priori_noise(campaign: Campaign) -> Noise:
    """Take the campaign's noise, or usual figures where it has none."""
    encoder_rad = campaign.encoder_rad or DEFAULT_ENCODER_RAD
    contact_mm = campaign.contact_mm or DEFAULT_CONTACT_MM
    return Noise(
        np.full(len(campaign.joint_names), encoder_rad),
        np.full(len(campaign.artefacts), contact_mm),
        campaign.orientation_rad or DEFAULT_ORIENTATION_RAD,
    )


EncoderGroups = Literal["held", "pooled", "each"]
ContactGroups = Literal["held", "pooled", "by_kind"]
OrientationGroups = Literal["held", "pooled"]
# A group with less redundancy than this says too little about itself.
_LEAST_REDUNDANCY = 5.0
_LARGEST_FACTOR = 100.0


@dataclass(frozen=True, slots=True)
class VarianceModel:
    """Which standard deviations are estimated.

    Attributes:
        encoders: None, one for all joints, or one a joint.
        contacts: None, one for all artefacts, or one a kind.
        orientations: None, or one for all.
    """

    encoders: EncoderGroups
    contacts: ContactGroups
    orientations: OrientationGroups = "held"

    @property
    def estimates(self) -> bool:
        return {self.encoders, self.contacts, self.orientations} != {"held"}


def variance_model(campaign: Campaign) -> VarianceModel:
    """Estimate what the campaign does not give."""
    has_unknown = campaign.orientation_rad is None and np.any(campaign.poses.oriented)
    return VarianceModel(
        "pooled" if campaign.encoder_rad is None else "held",
        "by_kind" if campaign.contact_mm is None else "held",
        "pooled" if has_unknown else "held",
    )


@dataclass(frozen=True, slots=True, eq=False)
class VarianceSums:
    """Squares of residuals and redundancies by source of noise.

    Attributes:
        squares: In units of the noise, joints first, then contacts with artefacts,
            orientations last, (n_joints + n_artefacts + 1,).
        redundancies: Likewise.
        information: How sources share the residuals: sums of tr(M C_i M C_j),
            (n_joints + n_artefacts + 1,) * 2.
        of_parts: Sums of squares of positions, and of orientations beyond what the
            positions say, and below them their redundancies, (2, 2).
    """

    squares: Floats
    redundancies: Floats
    information: Floats
    of_parts: Floats


def better_noise(
    campaign: Campaign, noise: Noise, sums: VarianceSums, model: VarianceModel
) -> tuple[Noise, float]:
    """Improve the standard deviations once, and say their largest relative change."""
    n_joints, kinds = len(noise.encoder_rad), [a.kind for a in campaign.artefacts]
    groups = _groups(n_joints, kinds, model)
    numbers = np.unique(groups[groups >= 0])
    members = (groups[np.newaxis] == numbers[:, np.newaxis]).astype(np.float64)
    kept = members @ sums.redundancies >= _LEAST_REDUNDANCY
    members = members[kept]
    factors = np.ones(len(groups))
    if len(members):
        theta = _thetas(members, sums)
        roots = np.clip(np.sqrt(theta), 1.0 / _LARGEST_FACTOR, _LARGEST_FACTOR)
        grouped = members.sum(axis=0) > 0.0
        factors[grouped] = (roots @ members)[grouped]
    change = float(np.max(np.abs(factors - 1.0)))
    better = Noise(
        noise.encoder_rad * factors[:n_joints],
        noise.contact_mm * factors[n_joints:-1],
        noise.orientation_rad * float(factors[-1]),
    )
    return better, change


def _groups(n_joints: int, kinds: list[str], model: VarianceModel) -> Integers:
    """Number the groups of joints, artefacts and orientations; -1: held."""
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
    last = -1 if model.orientations == "held" else n_joints + len(kinds)
    return np.array([*joints, *artefacts, last], dtype=np.int64)


def _thetas(members: Floats, sums: VarianceSums) -> Floats:
    """Solve for the factors of the groups' variances, (n_groups,)."""
    sums_of_groups, redundancies = members @ sums.squares, members @ sums.redundancies
    matrix = members @ sums.information @ members.T
    # What is held takes its part of the squares as it is.
    held = members @ sums.information @ (1.0 - members.sum(axis=0))
    not_shared = redundancies - matrix.sum(axis=1) - held
    solved = np.linalg.lstsq(
        matrix + np.diag(not_shared), sums_of_groups - held, rcond=1e-6
    )[0]
    ratios = sums_of_groups / redundancies
    return np.where(solved > 0.1 * ratios, solved, ratios)
