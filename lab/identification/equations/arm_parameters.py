"""The parameters that an arm has, and the choice of those that are free."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.identification.equations.effect_model import EffectModel
from traverse.lab.identification.equations.parameters import Parameters

# Plausible deviations from the design, which are the units of rank decisions.
AXIS_TOLERANCE_RAD = 0.02
LINK_TOLERANCE_MM = 5.0
ORIGIN_TOLERANCE_MM = 100.0
ZERO_TOLERANCE_RAD = 1.0


def arm_parameters(
    geometry: Geometry,
    joint_names: Sequence[str],
    effects: EffectModel | None = None,
) -> Parameters:
    """List the parameters of an arm; axes and links are free.

    Effects are held at their values, until they are freed.
    """
    joints = [
        f"{name}.{what}.{component}"
        for name in joint_names
        for what in ("axis", "link")
        for component in "vw"
    ]
    rest = [f"{of}.{axis}" for of in ("origin", "probe.vector") for axis in "xyz"]
    zeros = [f"{name}.zero" for name in joint_names]
    n = len(joint_names)
    tolerances = [
        *([AXIS_TOLERANCE_RAD] * 2 + [LINK_TOLERANCE_MM] * 2) * n,
        *[ORIGIN_TOLERANCE_MM] * 3,
        *[LINK_TOLERANCE_MM] * 3,
        *[ZERO_TOLERANCE_RAD] * n,
    ]
    free = np.ones(len(tolerances), dtype=np.bool_)
    free[4 * n : 5 * n + 6] = False
    if effects is not None:
        tolerances += effects.tolerances.tolist()
        free = np.append(free, np.zeros(len(effects.names), dtype=np.bool_))
    return Parameters(
        names=(*joints, *rest, *zeros, *(() if effects is None else effects.names)),
        units=(
            *(["rad"] * 2 + ["mm"] * 2) * n,
            *["mm"] * 6,
            *["rad"] * n,
            *(() if effects is None else effects.units),
        ),
        tolerances=np.array(tolerances),
        free=free,
        smallest=tuple(int(at) for at in np.argmin(np.abs(geometry.axes), axis=1)),
        effects=effects,
    )


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
