"""Plausible amplitudes of the columns of candidates.

They are those of the identification: both ask the table of effects.
"""

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.base.correction import Correction
from traverse.kinematics.effects.mechanics.base_step import BaseStep
from traverse.kinematics.effects.readings.count_slip import CountSlip
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.plausible_sizes import plausible_values

# Of steps, whose moments are scanned, and of curves without a name.
STEP_RAD = EFFECT_KINDS[CountSlip.kind].size
STEP_MM = EFFECT_KINDS[BaseStep.kind].size
CURVE_RAD = EFFECT_KINDS[Empirical.kind].size
CURVE_MM = 0.01


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
