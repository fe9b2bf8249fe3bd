"""Excluded poses that lie together.

A blunder may be anywhere. Where excluded poses gather in a range of a joint's angle,
the arm does something there that its model lacks: they tell more about it than all
others, and without them the arm would be fitted to where it is easy. They take part
again. Those that gather on one artefact or in time may tell of a socket that moved:
they stay out. So do the few that chance brings together: taking blunders back costs
more than leaving such poses out. Either is reported.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans
from traverse.lab.adjustment.iterate import IteratedAdjustment
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.statistics.outlier_clusters import Cluster, Line, find_outlier_cluster

_N_DRAWS = 300


_MOST_CLUSTERS = 3


# A blunder may be there as well: so many times the median of the others' |w|.
_MUCH_WORSE = 4.0


# Probability of a cluster by chance, below which it is a finding about the arm: one
# that is reported at 0.001 would bring back blunders of one campaign in hundreds.
_BY_CHANCE = 1e-6


# Adjusts a campaign again, with a noise or as it is found, and poses that stay.
Again = Callable[[Campaign, None, Booleans], IteratedAdjustment]


@dataclass(frozen=True, slots=True)
class ExcludedCluster:
    """Where excluded poses lay together, and whether they take part again."""

    cluster: Cluster
    taken_back: bool


def with_clusters_back(
    campaign: Campaign, run: IteratedAdjustment, again: Again
) -> tuple[IteratedAdjustment, tuple[ExcludedCluster, ...]]:
    """Take excluded poses back that lie together in the range of a joint.

    Returns the last adjustment, and the clusters found.
    """
    poses = campaign.poses
    lines: list[Line] = [
        (f"{name}_rad", name, poses.angles_rad[:, joint])
        for joint, name in enumerate(campaign.joint_names)
    ]
    lines.append(("time_s", None, poses.time_s))
    names = [artefact.id for artefact in campaign.artefacts]
    staying = np.zeros(len(poses), dtype=np.bool_)
    found: list[ExcludedCluster] = []
    # Neighbouring samples of a stream are out together because they are alike.
    while len(found) < _MOST_CLUSTERS and not campaign.is_stream:
        place = find_outlier_cluster(
            lines, poses.artefacts, names, run.included, n_draws=_N_DRAWS, seed=1
        )
        if place is None:
            break
        there = np.zeros(len(poses), dtype=np.bool_)
        if place.joint is not None:
            read_rad = poses.angles_rad[:, campaign.joint_names.index(place.joint)]
            there = (read_rad >= place.low) & (read_rad <= place.high)
        there &= ~run.included
        if np.any(there):
            w = run.statistics.w
            there &= ~(w > _MUCH_WORSE * np.nanmedian(w[there]))
        artefacts = np.unique(poses.artefacts[there])
        of_joint = (
            place.joint is not None
            and (len(artefacts) > 1 or len(np.unique(poses.artefacts)) == 1)
            and place.log_p < math.log(_BY_CHANCE)
        )
        found.append(ExcludedCluster(place, of_joint))
        if not of_joint:
            break
        staying |= there
        run = again(campaign, None, staying)
    return run, tuple(found)
