"""Data snooping: poses that contradict the others leave, and may come back.

The worst contradict first, because one blunder makes its neighbours look bad; with
many poses several leave at a time, all those near the worst. Whoever agrees with the
estimates of the rest is taken back.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.identification.equations.network import stations
from traverse.lab.identification.solve.adjustment import Adjustment
from traverse.lab.identification.solve.pose_statistics import (
    PoseStatistics,
    statistics_of_excluded,
)
from traverse.lab.statistics.distributions import (
    median_of_chi_square,
    normal_quantile,
    tau_critical,
)

# Poses leave together when their |w| is above this part of the worst one's.
_NEAR_THE_WORST = 0.4
# An artefact keeps at least this part of its poses: else the artefact is wrong.
_LEAST_PART = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SnoopingResult:
    """One round of tests.

    Attributes:
        included: Who goes on, (n_poses,).
        critical: |w| above which a pose is excluded.
        scale: Robust a-posteriori standard deviation of unit weight.
        n_changed: How many left or came back.
    """

    included: Booleans
    critical: float
    scale: float
    n_changed: int


def snoop(
    adjustment: Adjustment,
    found: PoseStatistics,
    included: Booleans,
    eligible: Booleans,
    *,
    family_level: float,
    noise_known: bool,
    radius_mm: float,
) -> SnoopingResult:
    """Decide who takes part in the next adjustment.

    Args:
        adjustment: With the included poses.
        found: Their statistics.
        included: Who took part, (n_poses,).
        eligible: Who may take part, (n_poses,).
        family_level: Probability that a campaign without blunders loses any pose.
        noise_known: Whether unit weight is known (w test) or estimated (tau test).
        radius_mm: Of the probe's ball.
    """
    n_poses = max(int(np.count_nonzero(included)), 1)
    level = family_level / n_poses
    scale = robust_scale(found)
    if noise_known:
        scale = max(scale, 1.0)
        critical = -normal_quantile(0.5 * level)
    else:
        critical = tau_critical(level, max(adjustment.redundancy, 2))
    w = np.where(included, np.nan_to_num(found.w) / scale, 0.0)
    worst = float(np.max(w, initial=0.0))
    leaving = w > max(critical, _NEAR_THE_WORST * worst)
    leaving &= _not_too_many(adjustment, w, leaving)
    network = adjustment.network
    outside = eligible & ~included
    back = np.zeros_like(included)
    if np.any(outside):
        others = stations(network.campaign, radius_mm, outside)
        theirs = statistics_of_excluded(adjustment, others).w / scale
        back = outside & (np.nan_to_num(theirs, nan=np.inf) < critical)
    changed = int(np.count_nonzero(leaving) + np.count_nonzero(back))
    return SnoopingResult((included & ~leaving) | back, critical, scale, changed)


def robust_scale(found: PoseStatistics) -> float:
    """Estimate sigma0 from the medians of the statistics of each kind of pose."""
    squares, weights = [], []
    for degrees in (1, 2, 3):
        mine = found.degrees == degrees
        if np.count_nonzero(mine) >= 5:
            median = float(np.median(found.statistics[mine]))
            squares.append(median / median_of_chi_square(degrees))
            weights.append(np.count_nonzero(mine) * degrees)
    if not squares:
        return 1.0
    return float(np.sqrt(np.average(squares, weights=weights)))


def _not_too_many(adjustment: Adjustment, w: Floats, leaving: Booleans) -> Booleans:
    """Keep the better half of every artefact's poses."""
    may_leave = np.ones_like(leaving)
    poses_of = adjustment.network.campaign.poses.artefacts
    for station in adjustment.network.stations:
        total = np.count_nonzero(poses_of == station.index)
        spare = len(station.poses) - int(np.ceil(_LEAST_PART * total))
        mine = station.poses[leaving[station.poses]]
        if len(mine) > spare:
            order = mine[np.argsort(w[mine])]
            may_leave[order[: len(mine) - max(spare, 0)]] = False
    return may_leave
