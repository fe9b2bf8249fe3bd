"""The gap: how far the arm is from where a model predicts it, on poses kept aside.

A pose that the model has not seen has the misclosure v (in units of its noise) with
the covariance I + Y Y^T, noise and the model's own uncertainty. S is the mean square

    S = sum over poses of v^T (I + Y Y^T)^-1 v / number of equations

which is 1 for a perfect model. Two models are compared on the same poses, with the
noise of the better one.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from traverse.arrays import Booleans, Floats
from traverse.lab.diagnosis.holdout.prediction import predicted, with_noise
from traverse.lab.diagnosis.model.result import HoldoutResult
from traverse.lab.identification.equations.noise import Noise
from traverse.lab.identification.solve.adjustment import Adjustment
from traverse.lab.identification.solve.options import Options
from traverse.lab.identification.solve.pose_statistics import PoseStatistics
from traverse.lab.identification.solve.snooping import robust_scale
from traverse.lab.statistics.distributions import normal_quantile

# A gap below that many standard deviations of S is none to speak of.
_LEAST_GAP = 3.0
_VETO_LEVEL = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class HoldoutComparison:
    """Two models on the poses that neither has seen.

    Attributes:
        before: Without what was added.
        after: With it.
        closed: Part of the gap that was closed, or None: too little to say.
        is_worse: Whether the poses are predicted worse than before.
        compared: Poses that count, (n_poses,).
        n_contradicting: Held-out poses that do not: blunders.
    """

    before: HoldoutResult
    after: HoldoutResult
    closed: float | None
    is_worse: bool
    compared: Booleans
    n_contradicting: int


def compare_on_holdout(
    before: Adjustment, after: Adjustment, held_out: Booleans, radius_mm: float
) -> HoldoutComparison:
    """Compare two models on held-out poses.

    Args:
        before: Fit to the choosing poses.
        after: With the terms; its noise weighs both, and poses that contradict it
            count for neither.
        held_out: (n_poses,).
        radius_mm: Of the probe's ball.
    """
    compared = uncontradicted(after, held_out, radius_mm)
    noise = after.network.noise
    first = predicted(with_noise(before, noise), compared, radius_mm)
    second = predicted(after, compared, radius_mm)
    was, now = _summary(before, first, compared), _summary(after, second, compared)
    return HoldoutComparison(
        was,
        now,
        closed(was.chi2, now.chi2, now.n),
        is_worse(first.statistics, second.statistics, second.degrees),
        compared,
        int(np.count_nonzero(held_out & ~compared)),
    )


def uncontradicted(model: Adjustment, held_out: Booleans, radius_mm: float) -> Booleans:
    """Choose the held-out poses that a model does not contradict.

    Poses are contradicted beyond the limit at which those of a fit are excluded, the
    level of the noise taken from the held-out poses themselves.

    Args:
        model: The final one.
        held_out: (n_poses,).
        radius_mm: Of the probe's ball.

    Returns:
        (n_poses,).
    """
    n_poses = int(np.count_nonzero(held_out))
    if n_poses == 0:
        return held_out.copy()
    found = predicted(model, held_out, radius_mm)
    level = Options().family_level / n_poses
    limit = -normal_quantile(0.5 * level) * max(robust_scale(found), 1.0)
    return held_out & (np.nan_to_num(found.w, nan=np.inf) <= limit)


def holdout_result(
    adjustment: Adjustment,
    held_out: Booleans,
    radius_mm: float,
    noise: Noise | None = None,
) -> HoldoutResult:
    """Say how well a fit predicts poses that took no part in it.

    Args:
        adjustment: The fit.
        held_out: Poses to predict, without blunders (`uncontradicted`), (n_poses,).
        radius_mm: Of the probe's ball.
        noise: To weigh with; default the fit's own.

    Returns:
        With NaN for everything where there are no poses.
    """
    weighed = adjustment if noise is None else with_noise(adjustment, noise)
    return _summary(weighed, predicted(weighed, held_out, radius_mm), held_out)


def closed(before: float, after: float, n: int) -> float | None:
    """Say which part of the gap is closed.

    Args:
        before: S without what was added.
        after: S with it.
        n: Equations that S is the mean of.

    Returns:
        1: all of it; below 0: it grew; None: the gap is within the scatter of S.
    """
    if n == 0 or before - 1.0 < _LEAST_GAP * np.sqrt(2.0 / n):
        return None
    return (before - after) / (before - 1.0)


def is_worse(
    before_statistics: Floats, after_statistics: Floats, degrees: Floats
) -> bool:
    """Say whether poses are predicted worse than before.

    A one-sided paired t-test over poses at 1 %.

    Args:
        before_statistics: v^T (I + Y Y^T)^-1 v, NaN for poses that do not count,
            (n_poses,).
        after_statistics: Likewise, (n_poses,).
        degrees: Equations of each pose, (n_poses,).
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
    adjustment: Adjustment, found: PoseStatistics, compared: Booleans
) -> HoldoutResult:
    n = int(np.count_nonzero(np.isfinite(found.misclosures_mm[compared])))
    if n == 0:
        return HoldoutResult(float("nan"), float("nan"), 0, None)
    misclosures_mm = found.misclosures_mm[compared]
    campaign = adjustment.network.campaign
    kinds = np.array([artefact.kind for artefact in campaign.artefacts])
    at_points = kinds[campaign.poses.artefacts[compared]] == "points"
    distances_mm = np.linalg.norm(misclosures_mm[at_points], axis=1)
    return HoldoutResult(
        rms_mm=float(np.sqrt(np.nanmean(misclosures_mm**2))),
        chi2=float(
            np.sum(found.statistics[compared]) / np.sum(found.degrees[compared])
        ),
        n=n,
        mean_distance_mm=float(np.mean(distances_mm)) if np.any(at_points) else None,
    )
