"""How large effects plausibly are in a campaign."""

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.base.correction import Correction
from traverse.lab.campaign.campaign import Campaign


def plausible_values(correction: Correction, campaign: Campaign) -> tuple[float, ...]:
    """Return a plausible standard deviation for each parameter, in its unit.

    Orders of magnitude of arms of a metre or two. They decide what a campaign cannot
    say anything about, and never how large an effect is estimated.
    """
    kind = EFFECT_KINDS[correction.kind]
    size = kind.plausible_size(getattr(correction, "order", None))
    if kind.is_size_of_campaign:
        size /= max(float(np.ptp(campaign.poses.time_s)), 1.0)
    return tuple(1.0 if key == kind.phase else size for key in correction.parameters)
