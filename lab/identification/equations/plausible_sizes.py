"""How large effects plausibly are: the scale on which what is known is judged.

Orders of magnitude of arms of a metre or two; drifts are per campaign. They decide
what a campaign cannot say anything about, and never how large an effect is estimated.
"""

from datetime import UTC, datetime, timedelta

import numpy as np

from traverse.kinematics.effects.base.context import Span
from traverse.kinematics.effects.base.correction import Correction
from traverse.lab.campaign.campaign import Campaign

# By kind, for each parameter whatever its component. Drifts: over a campaign.
_PLAUSIBLE = {
    "encoder_eccentricity": 3e-5,
    "encoder_scale": 20.0,
    "encoder_temperature": 1e-5,
    "encoder_drift": 3e-5,
    "count_slip": 5e-5,
    "encoder_latency": 1e-4,
    "backlash": 1e-5,
    "joint_compliance": 1e-5,
    "bearing_compliance": 1e-5,
    "mount_compliance": 1e-5,
    "thermal_expansion": 1e-5,
    "axis_wobble": 1e-5,
    "axis_runout": 0.01,
    "probe_radius": 0.01,
    "probe_lobing": 0.005,
    "stylus_bending": 0.01,
    "base_drift": 0.03,
    "base_step": 0.03,
    "artefact_length": 10.0,
    "empirical": 1e-5,
}
# Of encoder harmonics, by order; above the last: sub-division errors.
_HARMONICS = {2: 2e-5, 3: 1e-5, 4: 1e-5}
_SUB_DIVISION = 5e-6
_PER_CAMPAIGN = ("encoder_drift", "base_drift")
_UNITS = {
    "scale_ppm": "ppm",
    "error_ppm": "ppm",
    "rate_rad_c": "rad/C",
    "rate_rad_s": "rad/s",
    "latency_s": "s",
    "compliance_rad_nm": "rad/(N m)",
    "expansion_per_c": "1/C",
    "compliance_mm_n": "mm/N",
    "rate_mm_s": "mm/s",
}
# When a campaign that does not say when it began is taken to have begun.
_NO_START = datetime(2000, 1, 1, tzinfo=UTC)


def plausible_values(correction: Correction, campaign: Campaign) -> tuple[float, ...]:
    """Say a plausible standard deviation for each parameter, in its unit."""
    if correction.kind == "encoder_harmonic":
        size = _HARMONICS.get(int(correction.variety[0]), _SUB_DIVISION)
    else:
        size = _PLAUSIBLE[correction.kind]
    if correction.kind in _PER_CAMPAIGN:
        size /= max(float(np.ptp(campaign.poses.time_s)), 1.0)
    if correction.kind == "probe_lobing":
        return size, 1.0
    return (size,) * len(correction.values)


def effect_units(correction: Correction) -> tuple[str, ...]:
    """Say the unit of each parameter."""
    return tuple(key_unit(name.partition(".")[0]) for name in correction.parameters)


def key_unit(key: str) -> str:
    """Say the unit of a key of `[[effects]]`."""
    return _UNITS.get(key, "mm" if key.endswith("_mm") else "rad")


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
