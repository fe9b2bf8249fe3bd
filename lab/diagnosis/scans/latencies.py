"""Latencies of single joints in a stream, before samples are chosen.

What a late reading adds to misclosures follows the speed, smoothly from sample to
sample: it would pass for noise that lasts, and leave too few samples to find it by.
So the first fit has a latency of every joint, and only noise is left of them.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm, effect_from_table
from traverse.kinematics.effects.readings.rates import EncoderLatency
from traverse.lab.campaign.campaign import Campaign, touching_stretches
from traverse.lab.campaign.poses import evenly
from traverse.lab.diagnosis.model.fit import Fit, fitted, with_effects
from traverse.lab.first_moments import own_effects

_FIRST_POSES = 800
_LATE = EncoderLatency.kind
_ROUNDS = 3
_LEAST_SAMPLES = 4


def first_fit_with_delays(
    campaign: Campaign, arm: Arm, usual_s: float
) -> tuple[Campaign, Fit]:
    """Fit some samples, with the speeds of late joints since the instants they show.

    The campaign with these speeds where they fit better, without the samples whose
    speeds are not known, and the fit.

    Args:
        campaign: Of a stream.
        arm: Whatever latencies it has are estimated, too.
        usual_s: From sample to sample; shorter latencies need no other speeds.
    """
    fit, measured = _first_fit(campaign, arm), campaign
    stretches = touching_stretches(campaign, 1.5 * usual_s)
    for _ in range(_ROUNDS):
        known = _latencies_s(fit.arm)
        late_s = np.array([known.get(name, 0.0) for name in campaign.joint_names])
        # What all joints share moves the ball along its path, which hardly shows.
        late_s -= np.median(late_s)
        late_s[np.abs(late_s) < usual_s] = 0.0
        if not np.any(late_s):
            break
        delayed = with_speeds_since(measured, stretches, late_s)
        if 2 * len(delayed.poses) < len(measured.poses):
            break  # no latency of a reading is as long as a stretch
        again = _first_fit(delayed, fit.arm)
        if again.adjustment.sigma0 > fit.adjustment.sigma0:
            break
        campaign, fit = delayed, again
    return campaign, fit


def with_speeds_since(
    campaign: Campaign, stretches: Integers, late_s: Floats
) -> Campaign:
    """Take the mean speed of late joints since the instant of their readings.

    Samples that are nearer to the end of their stretch are left out.

    Strategy: a reading that is late by T shows its true angle T later, so that its
    error is T times the mean speed until then. The speed that it shows itself is late
    as well: over some milliseconds of a hand's motion that leaves many times the noise,
    for whatever else can take it.

    Args:
        campaign: With speeds, as far as there are any.
        stretches: Of samples without a gap, (n_poses,).
        late_s: Latencies, (n_joints,).
    """
    poses = campaign.poses
    if poses.speeds_rad_s is None:
        return campaign
    speeds = poses.speeds_rad_s.copy()
    known = np.ones(len(poses), dtype=np.bool_)
    for stretch in np.unique(stretches):
        rows = np.flatnonzero(stretches == stretch)
        time_s = poses.time_s[rows]
        if len(rows) < _LEAST_SAMPLES:
            known[rows] = not np.any(late_s)
            continue
        for joint in np.flatnonzero(late_s):
            shown_s = time_s + late_s[joint]
            known[rows] &= (shown_s >= time_s[0]) & (shown_s <= time_s[-1])
            readings_rad = CubicSpline(time_s, poses.angles_rad[rows, joint])
            rises_rad = readings_rad(shown_s) - readings_rad(time_s)
            speeds[rows, joint] = rises_rad / late_s[joint]
    led = replace(campaign, poses=replace(poses, speeds_rad_s=speeds))
    return led.part(np.flatnonzero(known))


def _first_fit(campaign: Campaign, arm: Arm) -> Fit:
    """Fit the arm and a latency of every joint to a few samples, spread evenly."""
    first = campaign.part(_spread(campaign))
    if campaign.poses.speeds_rad_s is not None:
        known = _latencies_s(arm)
        added = tuple(
            effect_from_table({"kind": _LATE, "joint": name, "latency_s": 0.0})
            for name in campaign.joint_names
            if name not in known
        )
        arm = with_effects(arm, (*own_effects(arm), *added))
    return fitted(first, arm, np.ones(len(first.poses), dtype=np.bool_))


def _latencies_s(arm: Arm) -> dict[str, float]:
    """List the latencies of single joints that an arm has."""
    return {
        str(effect.joint): float(effect.values["latency_s"])
        for effect in arm.effects
        if effect.kind == _LATE and effect.joint is not None
    }


def _spread(campaign: Campaign) -> Integers:
    """Take as many samples from each artefact, evenly."""
    indices = campaign.poses.artefacts
    each = -(-_FIRST_POSES // len(campaign.artefacts))
    chosen = [
        evenly(np.flatnonzero(indices == index), each) for index in np.unique(indices)
    ]
    return np.sort(np.concatenate(chosen))
