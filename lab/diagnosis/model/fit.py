"""Fits of the arm with terms: the geometry and all terms estimated together."""

from dataclasses import dataclass
from glob import escape

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.effect_model import effect_model
from traverse.lab.identification.equations.network import network_of
from traverse.lab.identification.identify import prepared
from traverse.lab.identification.results.postprocessing import arm_of_adjustment
from traverse.lab.identification.solve.adjustment import Adjustment
from traverse.lab.identification.solve.iterative_adjustment import (
    Options,
    iterate,
)
from traverse.lab.identification.solve.reliability import PoseStatistics
from traverse.lab.identification.solve.starting_values import with_tools_fitted


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """An arm with terms, fitted to some poses of a campaign.

    Attributes:
        arm: As estimated, effects included.
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
    """Fit an arm and all its effects to eligible poses, (n_poses,).

    Contradicting poses are left out when snooping; poses left out of an earlier fit,
    whose noise and poses are begun with, are tried again. The noise that the campaign
    does not state is estimated.

    Raises:
        IdentificationError: The campaign lacks data that effects need.
    """
    free = free_effects(campaign, arm)
    options = Options(coarse_start=False, n_suggestions=0, free=free, snooping=snooping)
    design, parameters = prepared(campaign, arm, options)
    radius_mm = arm.probe.radius_mm
    noise = None if before is None else before.adjustment.network.noise
    network = network_of(campaign, radius_mm, eligible, parameters, noise)
    first = None if before is None else before.included
    found = iterate(network, design, options, radius_mm, first=first)
    adapted = arm_of_adjustment(arm, found.adjustment)
    return Fit(adapted, found.adjustment, found.statistics, found.included)


def with_tools_begun(campaign: Campaign, arm: Arm) -> Campaign:
    """Begin with tools that fit to the arm as given.

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    if not campaign.tools:
        return campaign
    design, parameters = prepared(campaign, arm, Options())
    fitted = with_tools_fitted(campaign, parameters, design, arm.probe.radius_mm)
    names = [tool.name for tool in campaign.tools]
    vectors_mm = dict(zip(names, fitted.tools_mm, strict=True))
    return campaign.with_tools(vectors_mm, held=False)


def free_effects(campaign: Campaign, arm: Arm) -> tuple[str, ...]:
    """Name all that is estimated of an arm's effects, as patterns."""
    if not arm.effects:
        return ()
    model = effect_model(arm, arm.effects, campaign)
    return tuple(escape(name) for name in model.names)


def with_effects(arm: Arm, effects: tuple[Effect, ...]) -> Arm:
    """Give an arm other effects."""
    return arm.model_copy(update={"effects": effects})
