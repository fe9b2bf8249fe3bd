"""What an adjustment begins with: the arm's values, and which parameters are free."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.adjustment.datum import with_datum
from traverse.lab.adjustment.effect_model import effect_model
from traverse.lab.adjustment.noise import VarianceModel
from traverse.lab.adjustment.parameters import (
    ArmValues,
    Parameters,
    arm_parameters,
    expected_by,
    masked,
)
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.prior import Prior


@dataclass(frozen=True, slots=True)
class Options:
    """What is estimated, and how.

    Attributes:
        hold: Patterns of parameters to hold at their design values.
        free: Patterns of parameters to free; `hold` has the last word.
        snooping: Whether contradicting poses are excluded.
        family_level: Probability that a campaign without blunders loses any pose.
        variances: Which noise is estimated; None: what the campaign does not give.
        coarse_start: Whether wrong zeros are looked for where the design fits badly.
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    snooping: bool = True
    family_level: float = 0.01
    variances: VarianceModel | None = None
    coarse_start: bool = True
    n_suggestions: int = 8


class IdentificationError(ValueError):
    """Arm, campaign and options are inconsistent."""


def prepared(
    campaign: Campaign, arm: Arm, options: Options
) -> tuple[ArmValues, Parameters]:
    """Make the design's values, and choose what is free.

    Raises:
        IdentificationError: A pattern fits no parameter, or effects do not fit.
    """
    geometry, prior = geometry_from_arm(arm), campaign.prior
    # Directions of components, and which are held, decide what others mean to a family.
    of_design = geometry if prior is None else geometry_from_arm(prior.design)
    try:
        effects = effect_model(arm, arm.effects, campaign) if arm.effects else None
    except ValueError as error:
        raise IdentificationError(str(error)) from error
    names = [tool.name for tool in campaign.tools]
    mounted = campaign.poses.mounted
    parameters = arm_parameters(
        of_design, campaign.joint_names, effects, names, mounted
    )
    in_the_arms_system = any(artefact.fixes_datum for artefact in campaign.artefacts)
    wishes = (*(("origin.*",) if in_the_arms_system else ()), *options.free)
    tools_mm = np.array(
        [tool.vector_mm or geometry.probe_vector_mm for tool in campaign.tools]
    ).reshape(-1, 3)
    try:
        held = [f"tool.{name}.?" for name in _held_tools(campaign)]
        parameters = parameters.with_free(masked(parameters, held, ()))
        parameters = parameters.with_free(masked(parameters, options.hold, wishes))
        if effects is not None:
            # Where no mass is known, what yields is estimated with what it yields to.
            wishes = (*wishes, *effects.moments_with(parameters.free_names))
            parameters = parameters.with_free(masked(parameters, options.hold, wishes))
    except ValueError as error:
        raise IdentificationError(str(error)) from error
    if not in_the_arms_system:
        parameters = with_datum(parameters, of_design, tools_mm=tools_mm)
    values = np.empty(0) if effects is None else effects.effects.values
    if prior is not None:
        _check_same_datum(prior, parameters)
        expected = expected_by(prior, of_design, campaign)
        parameters = replace(parameters, expected=expected)
    unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(mounted), 1))
    return ArmValues(geometry, values, tools_mm, unturned), parameters


_OF_DATUM = (".axis.", ".link.", "origin.")


def _check_same_datum(prior: Prior, parameters: Parameters) -> None:
    """Refuse a family whose parameters mean something else, as others were held.

    Raises:
        IdentificationError: Other axes, links or origins are free than in the family.
    """
    theirs, ours = (
        {name for name in names if any(part in name for part in _OF_DATUM)}
        for names in (prior.estimated, parameters.free_names)
    )
    if theirs != ours:
        raise IdentificationError(
            f"{prior.family}: its arms were identified with other parameters free: "
            f"{', '.join(sorted(theirs ^ ours))}; identify all with the "
            "same --hold and --free, on artefacts of the same kind of place"
        )


def _held_tools(campaign: Campaign) -> list[str]:
    """Name the tools that are held.

    Where no pose has the arm's own, the first one is: what its vector is off is in
    the last link, as that of the probe is otherwise.
    """
    if campaign.poses.tools is None:
        return []
    used = np.unique(campaign.poses.tools)
    return [
        tool.name
        for number, tool in enumerate(campaign.tools, start=1)
        if tool.held or number not in used or number == used[0]
    ]
