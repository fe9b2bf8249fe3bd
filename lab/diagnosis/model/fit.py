"""Fits of the arm with terms: the geometry and all terms estimated together."""

from dataclasses import dataclass
from glob import escape

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.effect_model import effect_model
from traverse.lab.identification.equations.network import Network, stations
from traverse.lab.identification.equations.noise import a_priori_noise
from traverse.lab.identification.identify import prepared
from traverse.lab.identification.results.postprocessing import arm_of_adjustment
from traverse.lab.identification.solve.adjustment import Adjustment
from traverse.lab.identification.solve.iterative_adjustment import IterativeAdjustment
from traverse.lab.identification.solve.options import Options
from traverse.lab.identification.solve.pose_statistics import PoseStatistics


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """An arm with terms, fitted to some poses of a campaign.

    Attributes:
        arm: As estimated, effects included.
        adjustment: How.
        statistics: Of all poses; of those that took no part: as predicted.
        included: Poses that took part, (n_poses,).
    """

    arm: Arm
    adjustment: Adjustment
    statistics: PoseStatistics
    included: Booleans


def fitted(
    campaign: Campaign,
    arm: Arm,
    eligible: Booleans,
    before: Fit | None = None,
    *,
    snooping: bool = True,
) -> Fit:
    """Fit an arm and all its effects.

    Contradicting poses are left out; whoever was left out of an earlier fit is tried
    again. The noise that the campaign does not state is estimated.

    Args:
        campaign: What was measured.
        arm: Where to begin.
        eligible: Poses that may take part, (n_poses,).
        before: An earlier fit, whose noise and poses are begun with.
        snooping: Whether contradicting poses are left out at all.

    Raises:
        IdentificationError: The campaign does not tell what effects need.
    """
    free: tuple[str, ...] = ()
    if arm.effects:
        free = tuple(
            escape(name) for name in effect_model(arm, arm.effects, campaign).names
        )
    options = Options(coarse_start=False, n_suggestions=0, free=free, snooping=snooping)
    design, parameters = prepared(campaign, arm, options)
    radius_mm = arm.probe.radius_mm
    network = Network(
        campaign,
        stations(campaign, radius_mm, eligible),
        parameters,
        a_priori_noise(campaign) if before is None else before.adjustment.network.noise,
        np.ones(len(campaign.poses)),
    )
    rounds = IterativeAdjustment(design, options, radius_mm, None)
    first = None if before is None else before.included
    adjustment, statistics, included, _ = rounds.run(network, first)
    return Fit(arm_of_adjustment(arm, adjustment), adjustment, statistics, included)


def with_effects(arm: Arm, effects: tuple[Effect, ...]) -> Arm:
    """Give an arm other effects."""
    return arm.model_copy(update={"effects": effects})
