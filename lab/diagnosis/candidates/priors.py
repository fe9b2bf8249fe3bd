"""How large and how likely effects are, before anything is looked at.

Sizes are those of the identification,
`traverse.lab.identification.equations.plausible_sizes`. Preferences are natural
logarithms and decide between names that the data hardly tell apart; they never decide
whether something is there.
"""

from traverse.kinematics.effects.base.correction import Correction
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.plausible_sizes import plausible_values

# Of steps, whose moments are scanned, and of curves without a name.
STEP_RAD = 5e-5
STEP_MM = 0.03
CURVE_RAD = 1e-5
CURVE_MM = 0.01

_LEAST_OF_HARMONICS = -3.0
_BY_KIND = {"bearing_compliance": -0.5, "encoder_temperature": -0.5}
# Expansion and latency are of the whole arm rather than of one joint.
_OF_ONE_JOINT = {"thermal_expansion": -0.7, "encoder_latency": -0.7}
_AXIS_MOTION = -1.0
_AXIS_MOTION_PER_ORDER = -0.5


def column_scales(
    correction: Correction, n_columns: int, campaign: Campaign
) -> tuple[float, ...]:
    """Say the plausible amplitude of each column of an effect.

    Args:
        correction: The effect, of any size.
        n_columns: Its freedoms; all of them are of one unit.
        campaign: Drifts are so much during it.

    Returns:
        In the unit of the effect's keys, (n_columns,).
    """
    return (plausible_values(correction, campaign)[0],) * n_columns


def log_prior(kind: str, joint: str | None, order: int | None) -> float:
    """Say how much an effect is preferred before the data are seen.

    Args:
        kind: Of the arm file's effects.
        joint: Its name, or None for the whole arm.
        order: Of a harmonic or of an error motion, or None.

    Returns:
        Natural logarithm, 0 for the usual ones, negative for unusual ones.
    """
    match kind:
        case "encoder_harmonic":
            return max(1.0 - (order or 1), _LEAST_OF_HARMONICS)
        case "axis_wobble" | "axis_runout":
            above = max((order or 2) - 2, 0)
            return _AXIS_MOTION + _AXIS_MOTION_PER_ORDER * above
        case "thermal_expansion" | "encoder_latency":
            return 0.0 if joint is None else _OF_ONE_JOINT[kind]
        case _:
            return _BY_KIND.get(kind, 0.0)
