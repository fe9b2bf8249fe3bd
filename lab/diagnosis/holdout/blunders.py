"""Blunders among the poses kept aside, judged by their neighbours.

A pose must not be called a blunder because the model under test fails to predict it.
What a model lacks changes little from a pose to the next ones in joint space; a
blunder is isolated. So each pose is compared with poses of the same feature: its
misclosure against the model *without* terms, less the median of its nearest
neighbours' misclosures, in units of the typical such difference at the artefact.

Where blunders would be more frequent among the poses kept aside than among the poses
used for choosing, something else is the matter, and none of them is a blunder.
"""

import numpy as np
from scipy import stats  # type: ignore[import-untyped] # ships no types
from scipy.spatial import cKDTree  # type: ignore[import-untyped] # ships no types

from traverse.arrays import Booleans, Floats
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.statistics.distributions import (
    equivalent_normal,
    median_of_chi_square,
    normal_quantile,
)

N_NEIGHBOURS = 5
# Probability that a campaign without blunders loses any pose.
_FAMILY_LEVEL = 1e-3
# Probability of so many more at the poses kept aside, by chance.
_SHARE_LEVEL = 1e-3


def find_blunders(
    campaign: Campaign, misclosures_mm: Floats, choosing: Booleans, held_out: Booleans
) -> Booleans:
    """Find the held-out poses that contradict their neighbours, (n_poses,).

    By the misclosures of all poses against the model without terms, NaN where there are
    none, (n_poses, 3). None of features with fewer than six poses.
    """
    w = np.zeros(len(campaign.poses))
    poses = campaign.poses
    for artefact in np.unique(poses.artefacts):
        mine = np.flatnonzero(poses.artefacts == artefact)
        differences_mm = np.full((len(mine), 3), np.nan)
        for feature in np.unique(poses.features[mine]):
            here = poses.features[mine] == feature
            differences_mm[here] = _from_neighbours(
                poses.angles_rad[mine[here]], misclosures_mm[mine[here]]
            )
        w[mine] = _sizes(differences_mm)
    n_judged = max(int(np.count_nonzero(held_out)), 1)
    contradicts = w > -normal_quantile(0.5 * _FAMILY_LEVEL / n_judged)
    found = held_out & contradicts
    table = [
        [np.count_nonzero(part & contradicts), np.count_nonzero(part & ~contradicts)]
        for part in (held_out, choosing)
    ]
    p_value = float(stats.fisher_exact(table, alternative="greater")[1])
    return found if p_value >= _SHARE_LEVEL else np.zeros_like(held_out)


def _from_neighbours(angles_rad: Floats, misclosures_mm: Floats) -> Floats:
    """Subtract the median of the nearest neighbours' misclosures, (n, 3)."""
    n_poses = len(angles_rad)
    if n_poses <= N_NEIGHBOURS:
        return np.full((n_poses, 3), np.nan)
    # Circles, so that a joint's turn has no seam.
    places = np.hstack([np.cos(angles_rad), np.sin(angles_rad)])
    nearest = cKDTree(places).query(places, k=N_NEIGHBOURS + 1)[1]
    # Equal poses may be listed before the pose itself.
    others = nearest != np.arange(n_poses)[:, np.newaxis]
    others[np.all(others, axis=1), -1] = False
    neighbours = nearest[others].reshape(n_poses, N_NEIGHBOURS)
    found: Floats = misclosures_mm - np.median(misclosures_mm[neighbours], axis=1)
    return found


def _sizes(differences_mm: Floats) -> Floats:
    """Return how unusual differences are, as |w| of a standard normal, (n,)."""
    squares = differences_mm**2
    degrees = np.count_nonzero(np.isfinite(squares), axis=1)
    known = degrees > 0
    found = np.zeros(len(squares))
    if np.count_nonzero(known) <= N_NEIGHBOURS:
        return found
    sums = np.nansum(squares[known], axis=1)
    n_rows = int(degrees[known][0])
    typical = float(np.median(sums)) / median_of_chi_square(n_rows)
    if typical > 0.0:
        found[known] = equivalent_normal(
            sums / typical, degrees[known].astype(np.float64)
        )
    return found
