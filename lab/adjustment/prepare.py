"""What an adjustment begins with: the arm's values, and which parameters are free."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from glob import escape

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.lab.adjustment.datum import with_datum
from traverse.lab.adjustment.effect_model import EffectModel, effect_model
from traverse.lab.adjustment.equations import sorted_stations
from traverse.lab.adjustment.noise import Noise, VarianceModel, a_priori_noise
from traverse.lab.adjustment.parameters import ArmValues, Expected, Parameters
from traverse.lab.adjustment.problem import Network
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.prior import Prior

# Plausible deviations from the design, which are the units of rank decisions.
AXIS_TOLERANCE_RAD = 0.02
LINK_TOLERANCE_MM = 5.0
ORIGIN_TOLERANCE_MM = 100.0
ZERO_TOLERANCE_RAD = 1.0
MOUNTING_TOLERANCE_RAD = 1.0


def arm_parameters(
    geometry: Geometry,
    joint_names: Sequence[str],
    effects: EffectModel | None = None,
    tools: Sequence[str] = (),
    mounted: Sequence[int] = (),
) -> Parameters:
    """List the parameters of an arm; axes, links, tools and mountings are free.

    Effects are held at their values, until they are freed. The numbers of tools that
    have orientations are rising, 0 the arm's own.
    """
    of_joints = (
        ("axis", "rad", AXIS_TOLERANCE_RAD),
        ("link", "mm", LINK_TOLERANCE_MM),
    )
    # Name, unit, tolerance, whether it is free.
    table: list[tuple[str, str, float, bool]] = [
        *(
            (f"{name}.{quantity}.{component}", unit, tolerance, True)
            for name in joint_names
            for quantity, unit, tolerance in of_joints
            for component in "vw"
        ),
        *((f"origin.{axis}", "mm", ORIGIN_TOLERANCE_MM, False) for axis in "xyz"),
        *((f"probe.vector.{axis}", "mm", LINK_TOLERANCE_MM, False) for axis in "xyz"),
        *((f"{name}.zero", "rad", ZERO_TOLERANCE_RAD, False) for name in joint_names),
        *(
            (f"tool.{name}.{axis}", "mm", ORIGIN_TOLERANCE_MM, True)
            for name in tools
            for axis in "xyz"
        ),
        *(
            (f"{name}.mounting.{axis}", "rad", MOUNTING_TOLERANCE_RAD, True)
            for name in (tool_key(tools, number) for number in mounted)
            for axis in "xyz"
        ),
    ]
    if effects is not None:
        columns = effects.names, effects.units, effects.tolerances.tolist()
        table += [(*row, False) for row in zip(*columns, strict=True)]
    names, units, tolerances, free = zip(*table, strict=True)
    return Parameters(
        names=names,
        units=units,
        tolerances=np.array(tolerances),
        free=np.array(free),
        smallest=tuple(int(at) for at in np.argmin(np.abs(geometry.axes), axis=1)),
        effects=effects,
        n_tools=len(tools),
        mounted=tuple(mounted),
    )


def tool_key(tools: Sequence[str], number: int) -> str:
    """Say how the names of a tool's parameters begin."""
    return f"tool.{tools[number - 1]}" if number else "probe"


def masked(
    parameters: Parameters, hold: Sequence[str], free: Sequence[str]
) -> Booleans:
    """Free and then hold parameters by patterns such as `J3.*`, (n_all,).

    Raises:
        ValueError: A pattern fits no parameter.
    """
    mask = parameters.free.copy()
    for patterns, value in ((free, True), (hold, False)):
        for pattern in patterns:
            fits = np.array([fnmatchcase(name, pattern) for name in parameters.names])
            if not np.any(fits):
                raise ValueError(
                    f"'{pattern}' fits no parameter; there are "
                    f"{', '.join(parameters.names)}"
                )
            mask[fits] = value
    return mask


def expected_by(prior: Prior, geometry: Geometry, campaign: Campaign) -> Expected:
    """Move a family's design, of this geometry, to where the family has its arms.

    Raises:
        ValueError: Effects of the design do not fit the campaign.
    """
    of_design = prior.design.effects
    effects = effect_model(prior.design, of_design, campaign) if of_design else None
    parameters = arm_parameters(geometry, campaign.joint_names, effects)
    every = parameters.with_free(np.ones_like(parameters.free))
    step = np.zeros(len(every.names))
    step[[every.names.index(name) for name in prior.names]] = prior.changes
    values = np.empty(0) if effects is None else effects.effects.values
    arm = every.moved(ArmValues(geometry, values), step)
    return Expected(prior.names, prior.stds, arm)


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
        n_suggestions: How many further poses are proposed.
        free_effects: Whether all values of the arm's effects are free.
    """

    hold: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    snooping: bool = True
    family_level: float = 0.01
    variances: VarianceModel | None = None
    coarse_start: bool = True
    n_suggestions: int = 8
    free_effects: bool = False

    @property
    def with_noise_held(self) -> "Options":
        """The same with the noise as stated, or as assumed."""
        return replace(self, variances=VarianceModel("held", "held"))


class IdentificationError(ValueError):
    """Arm, campaign and options are inconsistent."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What an adjustment of a campaign begins with.

    Attributes:
        design: Values of the arm as given.
        parameters: Of the arm, and which of them are free.
        radius_mm: Of the probe's ball.
    """

    campaign: Campaign
    design: ArmValues
    parameters: Parameters
    radius_mm: float

    @classmethod
    def of(cls, campaign: Campaign, arm: Arm, options: Options) -> "Problem":
        """Take the values of an arm, and choose what is free.

        Raises:
            IdentificationError: A pattern fits no parameter, or effects do not fit.
        """
        design, parameters = _prepared(campaign, arm, options)
        return cls(campaign, design, parameters, arm.probe.radius_mm)

    def network(
        self, included: Booleans | None = None, noise: Noise | None = None
    ) -> Network:
        """Set up the equations of some poses, (n_poses,), all of the same weight.

        Default are all poses, and the noise as stated or assumed.
        """
        n_poses = len(self.campaign.poses)
        every = np.ones(n_poses, dtype=np.bool_)
        return Network(
            campaign=self.campaign,
            radius_mm=self.radius_mm,
            parameters=self.parameters,
            noise=noise or a_priori_noise(self.campaign),
            weights=np.ones(n_poses),
            stations=sorted_stations(
                self.campaign, self.radius_mm, every if included is None else included
            ),
        )


def _prepared(
    campaign: Campaign, arm: Arm, options: Options
) -> tuple[ArmValues, Parameters]:
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
    free = [*(("origin.*",) if in_the_arms_system else ()), *options.free]
    if effects is not None and options.free_effects:
        free += map(escape, effects.names)
    tools_mm = np.array(
        [tool.vector_mm or geometry.probe_vector_mm for tool in campaign.tools]
    ).reshape(-1, 3)
    try:
        held = [f"tool.{name}.?" for name in _held_tools(campaign)]
        parameters = parameters.with_free(masked(parameters, held, ()))
        parameters = parameters.with_free(masked(parameters, options.hold, free))
        if effects is not None:
            # Where no mass is known, what yields is estimated with what it yields to.
            free += effects.moments_with(parameters.free_names)
            parameters = parameters.with_free(masked(parameters, options.hold, free))
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
