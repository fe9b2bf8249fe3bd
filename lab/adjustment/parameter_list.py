"""Which parameters an arm has, and which of them are free."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment.arm_values import ArmValues, Expected
from traverse.lab.adjustment.effect_model import EffectModel, effect_model
from traverse.lab.adjustment.parameters import Parameters
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
