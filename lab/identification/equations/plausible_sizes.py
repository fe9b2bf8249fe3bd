"""How large effects plausibly are: the scale on which what is known is judged.

Orders of magnitude of arms of a metre or two, from the table of effects. They decide
what a campaign cannot say anything about, and never how large an effect is estimated.
"""

from datetime import UTC, datetime, timedelta

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS, key_unit
from traverse.kinematics.effects.base.context import Span
from traverse.kinematics.effects.base.correction import Correction
from traverse.lab.campaign.campaign import Campaign

# When a campaign that does not say when it began is taken to have begun.
_NO_START = datetime(2000, 1, 1, tzinfo=UTC)


def plausible_values(correction: Correction, campaign: Campaign) -> tuple[float, ...]:
    """Say a plausible standard deviation for each parameter, in its unit."""
    kind = EFFECT_KINDS[correction.kind]
    size = kind.plausible_size(getattr(correction, "order", None))
    if kind.is_size_of_campaign:
        size /= max(float(np.ptp(campaign.poses.time_s)), 1.0)
    return tuple(1.0 if key == kind.phase else size for key in correction.parameters)


def effect_units(correction: Correction) -> tuple[str, ...]:
    """Say the unit of each parameter."""
    return tuple(key_unit(name.partition(".")[0]) for name in correction.parameters)


def campaign_start(campaign: Campaign) -> datetime:
    """Say when a campaign's time is 0."""
    return campaign.start_utc or _NO_START


def campaign_span(campaign: Campaign) -> Span:
    """Say from when to when a campaign lasted."""
    start = campaign_start(campaign)
    times_s = campaign.poses.time_s
    if len(times_s) == 0:
        return start, start
    first_s, last_s = min(float(times_s.min()), 0.0), float(times_s.max())
    # Both a little wider than the poses, whose times are rounded to nanoseconds.
    margin = timedelta(milliseconds=1)
    return (
        start + timedelta(seconds=first_s) - margin,
        start + timedelta(seconds=last_s) + margin,
    )
