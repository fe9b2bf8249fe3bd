"""The gap: how far the arm is from where a model predicts it, on poses kept aside.

A pose that was not used by the fit has the misclosure v (in units of its noise) with
the covariance I + Y Y^T, noise and the model's own uncertainty. S is the mean square

    S = sum over poses of v^T (I + Y Y^T)^-1 v / number of equations

which is 1 for a perfect model. Two models are compared on the same poses, with the
noise of the final one. All poses kept aside count; figures without blunders are added
beside them.

A pose must not be called a blunder because the model under test fails to predict it.
What a model lacks changes little from a pose to the next ones in joint space; a
blunder is isolated. So each pose is compared with poses of the same feature: its
misclosure against the model *without* terms, less the median of its nearest
neighbours' misclosures, in units of the typical such difference at the artefact. Where
blunders would be more frequent than among the poses used for choosing, something else
is the matter, and none of them is a blunder.
"""

import numpy as np
from scipy import special
from scipy.spatial import cKDTree  # ships no types

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment import Adjustment, Noise, Options, PoseStatistics
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.result import HoldoutComparison
from traverse.lab.outcomes.diagnosis import HoldoutMisfit, HoldoutResult
from traverse.lab.statistics.distributions import (
    equivalent_normal,
    excess_p_value,
    median_of_chi_square,
    normal_quantile,
)

_VETO_LEVEL = 0.01
# S contradicts a model that is said to be complete: by how much, how surely.
_LEAST_MISFIT = 1.5
_MISFIT_LEVEL = 1e-3
# Of the measured volume: more is no noise of any arm.
_GROSS_PART = 0.01
# Of the sum of the links.
_LEAST_VOLUME = 0.1


def held_out_blunders(before: Adjustment, held_out: Booleans) -> Booleans:
    """Find blunders among held-out poses by their neighbours, (n_poses,).

    From a fit to the choosing poses, without terms.
    """
    if not np.any(held_out):
        return held_out.copy()
    statistics = before.pose_statistics()
    outside = ~np.any(np.isfinite(statistics.misclosures_mm), axis=1)
    statistics.fill(before.predicted(outside), outside)
    campaign = before.network.campaign
    return find_blunders(
        campaign,
        statistics.misclosures_mm,
        ~held_out,
        held_out,
        orientation_errors_rad=statistics.orientation_errors_rad,
    )


def compare_on_holdout(
    before: Adjustment,
    after: Adjustment,
    held_out: Booleans,
    *,
    blunders: Booleans | None = None,
    noise: Noise | None = None,
) -> HoldoutComparison:
    """Compare a fit to the choosing poses with one with terms, on all held-out poses.

    Figures without blunders are reported beside those of all. The noise weighs both;
    default that of the second.
    """
    noise = after.network.noise if noise is None else noise
    without_blunders = held_out if blunders is None else held_out & ~blunders
    first = before.with_noise(noise).predicted(held_out)
    second = after.with_noise(noise).predicted(held_out)
    was, now = (
        _summary(model, statistics, held_out, without_blunders)
        for model, statistics in ((before, first), (after, second))
    )
    worse = [
        is_worse(first.statistics[part], second.statistics[part], second.degrees[part])
        for part in (held_out, without_blunders)
    ]
    return HoldoutComparison(was, now, any(worse))


def find_misfit(
    model: Adjustment, held_out: Booleans, blunders: Booleans
) -> HoldoutMisfit | None:
    """Return where held-out poses contradict a model that explains the others.

    At which artefact they do so most; None: they agree with the model.

    S of all held-out poses but the blunders is half as large again as that of the
    poses of the fit, and so large by chance in one of a thousand (F test); or their
    rms is beyond a hundredth of the measured volume, or of a tenth of the reach where
    that is more, whatever the noise that was estimated: so much is no noise of any arm.
    """
    judged = held_out & ~blunders
    if not np.any(judged):
        return None
    statistics = model.predicted(judged)
    figures = _summary(model, statistics, judged, judged)
    # The noise may be larger than stated.
    ratio = figures.chi2 / max(model.sigma0, 1.0) ** 2
    degrees = float(np.sum(statistics.degrees[judged]))
    p_value = float(special.fdtrc(degrees, max(model.redundancy, 1), ratio))
    is_gross = figures.rms_mm > _GROSS_PART * _volume_mm(model)
    if not is_gross and (ratio < _LEAST_MISFIT or p_value > _MISFIT_LEVEL):
        return None
    network = model.network
    artefacts = network.campaign.poses.artefacts
    excess = np.nan_to_num(
        np.where(judged, statistics.statistics - statistics.degrees, 0.0)
    )
    worst = int(np.argmax(np.bincount(artefacts, weights=excess)))
    level = Options().family_level / figures.n_poses
    contradicts = judged & (statistics.w > -normal_quantile(0.5 * level))
    at_worst = judged & (artefacts == worst)
    return HoldoutMisfit(
        artefact=network.campaign.artefacts[worst].id,
        figures=figures,
        is_gross=is_gross,
        log_p=float(np.log(max(p_value, 1e-300))),
        n_contradicting=int(np.count_nonzero(contradicts)),
        n_contradicting_there=int(np.count_nonzero(contradicts & at_worst)),
        n_poses_there=int(np.count_nonzero(at_worst)),
    )


def _volume_mm(model: Adjustment) -> float:
    """Return how large the measured volume is: the rms distance from its centre.

    A tenth of the links' lengths at least.
    """
    centres_mm = np.concatenate(
        [
            model.network.centres_mm(station, model.state.arm)
            for station in model.network.stations
        ]
    )
    measured_mm = float(np.sqrt(np.sum(np.var(centres_mm, axis=0))))
    # A single cone has none.
    links_mm = np.linalg.norm(model.state.arm.geometry.links_mm, axis=1)
    return max(measured_mm, _LEAST_VOLUME * float(np.sum(links_mm)))


# Part of a misfit: models that differ by less predict alike.
_SAME = 0.999


def is_better(result: HoldoutResult, other: HoldoutResult) -> bool:
    """Return whether poses are predicted nearer than by another model, blunders aside.

    Both by their rms and in units of the uncertainty.
    """
    first, second = result.without_blunders or result, other.without_blunders or other
    return first.rms_mm < _SAME * second.rms_mm and first.chi2 < _SAME * second.chi2


# Times the mean square of the stated noise: what a campaign may be beyond it at most.
_SEVERAL_TIMES = 3.0


def noise_exceeded(
    campaign: Campaign, figures: HoldoutResult, choosing: Adjustment
) -> float | None:
    """Return how many times the stated noise poses kept aside are from the model.

    As a mean square; None: the noise is not stated, or it explains them. Where no poses
    were kept aside those of the fit tell.

    Strategy: a test of effects does not need the level of the noise, and so it calls
    whatever has no pattern noise. A stated level contradicts that: a probe of 4 um does
    not miss by 12. What is beyond is noise that was stated too small or a fault that no
    candidate describes, and neither is clean. Stated noise is often a guess and may be
    1.7 times too small (a mean square of 3); three standard deviations of the mean
    square must lie above that.
    """
    if not campaign.states_noise:
        return None
    last = figures.without_blunders or figures
    times, n = last.chi2, last.n
    if n == 0:
        times, n = choosing.sigma0**2, max(choosing.redundancy, 1)
    surely = times * (1.0 - 3.0 * float(np.sqrt(2.0 / n)))
    return times if surely > _SEVERAL_TIMES else None


# Standard deviations of a mean square of noise alone.
_OPEN_GAP = 4.0


def is_noise(figures: HoldoutResult) -> bool:
    """Return whether noise explains how poses kept aside are predicted."""
    last = figures.without_blunders or figures
    return last.n == 0 or last.chi2 <= 1.0 + _OPEN_GAP * last.chi2_std


def is_worse(
    before_statistics: Floats, after_statistics: Floats, degrees: Floats
) -> bool:
    """Return whether poses are predicted worse than before.

    A one-sided paired t-test at 1 % over v^T (I + Y Y^T)^-1 v of all poses, (n_poses,)
    and NaN where one does not count; the degrees are the equations of each.
    """
    counts = np.isfinite(before_statistics) & np.isfinite(after_statistics)
    counts &= np.nan_to_num(degrees) > 0.0
    growths = (after_statistics - before_statistics)[counts]
    n = len(growths)
    if n < 2 or float(np.mean(growths)) <= 0.0:
        return False
    error = float(np.std(growths, ddof=1)) / np.sqrt(n)
    critical = float(special.stdtrit(n - 1, 1.0 - _VETO_LEVEL))
    return bool(np.mean(growths) > critical * error)


def _summary(
    adjustment: Adjustment,
    statistics: PoseStatistics,
    poses: Booleans,
    without_blunders: Booleans,
) -> HoldoutResult:
    """Summarise the poses kept aside, beside it those that are no blunders."""
    without = None
    if np.any(poses & ~without_blunders):
        without = _summary(adjustment, statistics, without_blunders, without_blunders)
    n = int(np.count_nonzero(np.isfinite(statistics.misclosures_mm[poses])))
    if n == 0:
        return HoldoutResult(float("nan"), float("nan"), 0, None)
    misclosures_mm = statistics.misclosures_mm[poses]
    campaign = adjustment.network.campaign
    kinds = np.array([artefact.kind for artefact in campaign.artefacts])
    at_points = kinds[campaign.poses.artefacts[poses]] == "points"
    distances_mm = np.linalg.norm(misclosures_mm[at_points], axis=1)
    degrees = float(np.sum(statistics.degrees[poses]))
    # Poses share the errors of the fit: S has the spread of a ratio, not of a sum.
    redundancy = max(adjustment.redundancy, 1)
    return HoldoutResult(
        rms_mm=float(np.sqrt(np.nanmean(misclosures_mm**2))),
        chi2=float(np.sum(statistics.statistics[poses]) / degrees),
        chi2_std=float(np.sqrt(2.0 / degrees + 2.0 / redundancy)),
        n=n,
        mean_distance_mm=float(np.mean(distances_mm)) if np.any(at_points) else None,
        n_poses=int(np.count_nonzero(poses)),
        largest_mm=float(np.sqrt(np.max(np.nansum(misclosures_mm**2, axis=1)))),
        without_blunders=without,
    )


N_NEIGHBOURS = 5
# Probability that a campaign without blunders loses any pose.
_FAMILY_LEVEL = 1e-3
# Probability of so many more at the poses kept aside, by chance.
_SHARE_LEVEL = 1e-3


def find_blunders(
    campaign: Campaign,
    misclosures_mm: Floats,
    choosing: Booleans,
    held_out: Booleans,
    *,
    orientation_errors_rad: Floats | None = None,
) -> Booleans:
    """Find the held-out poses that contradict their neighbours, (n_poses,).

    By the misclosures of all poses against the model without terms, NaN where there are
    none, (n_poses, 3). None of features with fewer than six poses. By orientations
    likewise, but of artefacts: their errors do not depend on the feature.
    """
    w = np.zeros(len(campaign.poses))
    poses = campaign.poses
    kinds = [(misclosures_mm, poses.features)]
    if orientation_errors_rad is not None:
        kinds.append((orientation_errors_rad, np.zeros_like(poses.features)))
    for artefact in np.unique(poses.artefacts):
        mine = np.flatnonzero(poses.artefacts == artefact)
        for misclosures, features in kinds:
            differences = np.full((len(mine), 3), np.nan)
            measured = np.isfinite(misclosures[mine, 0])
            for feature in np.unique(features[mine]):
                at_feature = measured & (features[mine] == feature)
                differences[at_feature] = _from_neighbours(
                    poses.angles_rad[mine[at_feature]], misclosures[mine[at_feature]]
                )
            w[mine] = np.maximum(w[mine], _sizes(differences))
    n_judged = max(int(np.count_nonzero(held_out)), 1)
    contradicts = w > -normal_quantile(0.5 * _FAMILY_LEVEL / n_judged)
    blunders = held_out & contradicts
    p_value = excess_p_value(
        int(np.count_nonzero(blunders)),
        int(np.count_nonzero(held_out)),
        int(np.count_nonzero(choosing & contradicts)),
        int(np.count_nonzero(choosing)),
    )
    return blunders if p_value >= _SHARE_LEVEL else np.zeros_like(held_out)


def _from_neighbours(angles_rad: Floats, misclosures_mm: Floats) -> Floats:
    """Subtract the median of the nearest neighbours' misclosures, (n, 3)."""
    n_poses = len(angles_rad)
    if n_poses <= N_NEIGHBOURS:
        return np.full((n_poses, 3), np.nan)
    # Circles, so that a joint's turn has no seam.
    places = np.hstack([np.cos(angles_rad), np.sin(angles_rad)])
    nearest = cKDTree(places).query(places, k=N_NEIGHBOURS + 1)[1]
    # Equal poses may be listed before the pose itself.
    not_itself = nearest != np.arange(n_poses)[:, np.newaxis]
    not_itself[np.all(not_itself, axis=1), -1] = False
    neighbours = nearest[not_itself].reshape(n_poses, N_NEIGHBOURS)
    differences_mm: Floats = misclosures_mm - np.median(
        misclosures_mm[neighbours], axis=1
    )
    return differences_mm


def _sizes(differences_mm: Floats) -> Floats:
    """Return how unusual differences are, as |w| of a standard normal, (n,)."""
    squares = differences_mm**2
    degrees = np.count_nonzero(np.isfinite(squares), axis=1)
    known = degrees > 0
    sizes = np.zeros(len(squares))
    if np.count_nonzero(known) <= N_NEIGHBOURS:
        return sizes
    sums = np.nansum(squares[known], axis=1)
    n_rows = int(degrees[known][0])
    typical = float(np.median(sums)) / median_of_chi_square(n_rows)
    if typical > 0.0:
        sizes[known] = equivalent_normal(
            sums / typical, degrees[known].astype(np.float64)
        )
    return sizes
