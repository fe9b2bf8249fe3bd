"""A recorded stream, thinned until its errors are no longer correlated.

Neighbouring samples share most of their error, so as poses they would count many
times over. What a model lacks changes with the posture, noise within less than that:
so the misclosures of a first fit, latencies included, less their running mean over a
small part of the motion, give the correlation time of the noise. Of each stretch on an
artefact every nth sample is kept.
"""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import Adjustment
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.campaign.campaign import Campaign, touching_stretches
from traverse.lab.diagnosis.scans.latencies import first_fit_with_delays


def with_surface_directions(campaign: Campaign, every: Adjustment) -> Campaign:
    """Return where spheres were touched: from the ball towards the material."""
    network, state = every.network, every.state
    directions = np.full((len(campaign.poses), 3), np.nan)
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        if not isinstance(station.artefact, Sphere | BallBar):  # no side is known
            continue
        balls_mm = network.centres_mm(station, state.arm)
        centres_mm, sense = unknowns[:3], 1.0
        if isinstance(station.artefact, BallBar):
            places_mm = unknowns[:6].reshape(2, 3)
            centres_mm = places_mm[campaign.poses.features[station.poses]]
        elif station.artefact.side == "inside":
            sense = -1.0
        away_mm = sense * (centres_mm - balls_mm)
        lengths_mm = np.linalg.norm(away_mm, axis=1, keepdims=True)
        directions[station.poses] = away_mm / np.maximum(lengths_mm, 1e-9)
    if not np.any(np.isfinite(directions)):
        return campaign
    return campaign.with_poses(directions=directions)


MOST_POSES = 2000
# Below this correlation samples count as independent.
_LEAST_CORRELATION = 0.02
# Its decay is fitted where it is above this, at so many lags at least.
_STEEP = 0.15
_LEAST_LAGS = 3
_LONGEST_LAG = 500
_MOST_LOOKED_AT = 100_000
# Motion of the fastest joint over which the running mean is taken.
_SAME_POSTURE_RAD = 1.0
_LEAST_WINDOW = 20


@dataclass(frozen=True, slots=True, eq=False)
class Decimation:
    """Which samples of a stream serve as poses.

    Attributes:
        poses: Indices of those, rising, (n_kept,).
        n_samples: Of the stream, in which something is touched.
        lasting_s: For how long noise lasts on each artefact; NaN: never touched.
        apart_s: How far apart the poses on each artefact are.
    """

    poses: Integers
    n_samples: int
    rate_hz: float
    lasting_s: tuple[float, ...]
    apart_s: tuple[float, ...]

    @property
    def is_capped(self) -> bool:
        """Whether fewer poses were kept than are independent."""
        pairs = zip(self.apart_s, self.lasting_s, strict=True)
        return any(apart > lasting for apart, lasting in pairs)


def decimated(
    campaign: Campaign, arm: Arm, most_poses: int = MOST_POSES
) -> tuple[Campaign, Decimation]:
    """Determine which samples to keep, and where surfaces were touched.

    The campaign, with directions where artefacts define them and without samples whose
    delays reach beyond their stretch, and which of its poses to keep.
    """
    usual_s = _usual_s(campaign)
    campaign, fit = first_fit_with_delays(campaign, arm, usual_s)
    stretches = touching_stretches(campaign, 1.5 * usual_s)
    every = undecimated(fit.adjustment, campaign)
    network, state = every.network, every.state
    lasting = np.ones(len(campaign.artefacts), dtype=np.int64)
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        found_mm = network.misclosures_mm(station, state.arm, unknowns)
        window = _window(campaign, station.poses)
        lasting[station.index] = _lasting(found_mm, stretches[station.poses], window)
    touched = np.isin(np.arange(len(lasting)), campaign.poses.artefacts)
    apart, poses = lasting, _every(campaign, stretches, lasting)
    while len(poses) > most_poses:
        apart = np.ceil(apart * 1.02 * len(poses) / most_poses).astype(np.int64)
        poses = _every(campaign, stretches, apart)
    return with_surface_directions(campaign, every), Decimation(
        poses=poses,
        n_samples=len(campaign.poses),
        rate_hz=1.0 / usual_s,
        lasting_s=tuple(np.where(touched, usual_s * lasting, np.nan).tolist()),
        apart_s=tuple(np.where(touched, usual_s * apart, np.nan).tolist()),
    )


def undecimated(adjustment: Adjustment, campaign: Campaign) -> Adjustment:
    """Put the equations of all samples where a fit of some of them ended.

    Artefacts that took no part in the fit are left out; nothing is linearised anew.
    """
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    network, state = adjustment.network, adjustment.state
    known, unknowns = network.known_stations(state, everyone, campaign)
    weights = np.ones(len(campaign.poses))
    return replace(
        adjustment,
        network=replace(network, campaign=campaign, stations=known, weights=weights),
        state=replace(state, unknowns=unknowns, corrections=()),
    )


def _usual_s(campaign: Campaign) -> float:
    """Return the usual time from sample to sample; streams of one sample: a second."""
    if len(campaign.poses) < 2:
        return 1.0
    return float(np.median(np.diff(campaign.poses.time_s)))


def _window(campaign: Campaign, poses: Integers) -> int:
    """Return how many samples the fastest joint usually takes for the same posture."""
    speeds = campaign.poses.speeds_rad_s
    if speeds is None:
        return _LONGEST_LAG
    fastest_rad_s = float(np.median(np.max(np.abs(speeds[poses]), axis=1)))
    samples = _SAME_POSTURE_RAD / (fastest_rad_s + 1e-9) / _usual_s(campaign)
    return int(np.clip(samples, _LEAST_WINDOW, _LONGEST_LAG))


def _lasting(values: Floats, stretches: Integers, window: int) -> int:
    """Find the first lag at which noise is hardly correlated any more.

    From misclosures in the order of time, (n, n_rows), less their running mean over a
    window in samples; stretches are numbered, (n,).
    """
    values, stretches = values[:_MOST_LOOKED_AT], stretches[:_MOST_LOOKED_AT]
    ends = np.flatnonzero(np.append(np.diff(stretches) != 0, True)) + 1
    starts = np.append(0, ends[:-1])
    padded = np.concatenate(
        [
            _without_mean(values[first:end], window)
            for first, end in zip(starts, ends, strict=True)
        ]
    )
    lags = np.arange(1, min(window, len(padded) - 1) + 1)
    total = float(np.mean(padded**2))
    if total == 0.0 or len(lags) < 4:
        return 1
    correlations = (
        np.array([_correlation(padded, stretches, lag) for lag in lags.tolist()])
        / total
    )
    # Less its running mean noise is a little correlated the other way at all lags.
    baseline = float(np.mean(correlations[len(correlations) // 2 :]))
    correlations = (correlations - baseline) / (1.0 - baseline)
    low = correlations < _LEAST_CORRELATION
    crossed = int(lags[np.argmax(low)]) if np.any(low) else int(lags[-1])
    return int(np.clip(_extrapolated(correlations), crossed, lags[-1]))


def _extrapolated(correlations: Floats) -> int:
    """Extrapolate when a correlation, at lags from 1 on, becomes low.

    From its initial decay: one that was estimated from few samples crosses the limit
    early by chance.
    """
    is_low = correlations < _STEEP
    n = int(np.argmax(is_low)) if np.any(is_low) else len(correlations)
    if n < _LEAST_LAGS:
        return n
    slope, start = np.polyfit(np.arange(1, n + 1), np.log(correlations[:n]), 1)
    if slope >= 0.0:
        return n
    return int(np.ceil((np.log(_LEAST_CORRELATION) - start) / slope))


def _correlation(values: Floats, stretches: Integers, lag: int) -> float:
    together = stretches[lag:] == stretches[:-lag]
    products: Floats = values[lag:][together] * values[:-lag][together]
    return float(np.sum(products)) / max(products.size, 1)


def _without_mean(values: Floats, window: int) -> Floats:
    """Take out the running mean over a window, (n, n_rows)."""
    n, half = len(values), window // 2
    sums = np.cumsum(np.vstack([np.zeros_like(values[:1]), values]), axis=0)
    first = np.maximum(np.arange(n) - half, 0)
    end = np.minimum(np.arange(n) + half + 1, n)
    means = (sums[end] - sums[first]) / (end - first)[:, np.newaxis]
    deviations: Floats = values - means
    return deviations


def _every(campaign: Campaign, stretches: Integers, apart: Integers) -> Integers:
    """Keep every so manyth sample of each stretch."""
    starts = np.flatnonzero(np.append(True, np.diff(stretches) != 0))
    within = np.arange(len(stretches)) - starts[stretches]
    kept = within % apart[campaign.poses.artefacts] == 0
    return np.flatnonzero(kept)
