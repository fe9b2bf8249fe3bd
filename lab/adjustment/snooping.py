"""Data snooping: poses that contradict the others are excluded, and may return.

The worst contradict first, because one blunder makes its neighbours look bad; with
many poses several leave at a time, all those near the worst. Whoever agrees with the
estimates of the rest is taken back.
"""

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment.adjusted import Adjustment
from traverse.lab.adjustment.pose_statistics import PoseStatistics
from traverse.lab.statistics.distributions import (
    normal_quantile,
    student_critical,
    tau_critical,
)

# Poses leave together when their |w| is above this part of the worst one's.
_NEAR_THE_WORST = 0.4
# An artefact keeps at least this part of its poses: else the artefact is wrong.
_LEAST_PART = 0.5


def snoop(
    adjustment: Adjustment,
    statistics: PoseStatistics,
    included: Booleans,
    eligible: Booleans,
    *,
    family_level: float,
    noise_known: bool,
) -> tuple[Booleans, float]:
    """Decide who of the eligible poses takes part in the next adjustment, (n_poses,).

    And the |w| above which a pose is excluded.
    A campaign without blunders loses any pose with the probability of the family. Where
    the noise is known the test is that of w, else that of tau.
    """
    n_poses = max(int(np.count_nonzero(included)), 1)
    level = family_level / n_poses
    scale = statistics.robust_scale
    if noise_known:
        scale = max(scale, 1.0)
        critical = returning = -normal_quantile(0.5 * level)
    else:
        # Those outside took no part in the estimate of the noise.
        critical = tau_critical(level, max(adjustment.redundancy, 2))
        returning = student_critical(level, adjustment.redundancy)
    w = np.where(included, np.nan_to_num(statistics.w) / scale, 0.0)
    worst = float(np.max(w, initial=0.0))
    leaving = w > max(critical, _NEAR_THE_WORST * worst)
    leaving &= _not_too_many(adjustment, w, leaving)
    outside = eligible & ~included
    back = np.zeros_like(included)
    if np.any(outside):
        others = adjustment.network.stations_of(outside)
        theirs = adjustment.pose_statistics(others).w / scale
        back = outside & (np.nan_to_num(theirs, nan=np.inf) < returning)
    return (included & ~leaving) | back, critical * scale


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
