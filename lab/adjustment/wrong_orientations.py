"""Orientations that contradict the rest, while the positions of their poses agree.

A pose is tested as a whole. Where it is excluded although its position alone agrees
with the others, its orientation is taken out instead, and the pose takes part again.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans
from traverse.lab.adjustment.iterate import IteratedAdjustment
from traverse.lab.campaign.campaign import Campaign


def contradict_by_orientation(run: IteratedAdjustment) -> Booleans:
    """Find poses that were excluded, but whose position alone agrees, (n_poses,).

    None of an adjustment that excluded nobody.
    """
    alone = run.statistics.w_position < run.critical  # NaN: has no orientation
    found: Booleans = alone & ~run.included & ~run.alternating
    return found if np.isfinite(run.critical) else np.zeros_like(found)


def without_orientations(campaign: Campaign, which: Booleans) -> Campaign:
    """Forget the orientations of some poses, (n_poses,)."""
    orientations = campaign.poses.orientations
    if orientations is None:
        return campaign
    kept = np.where(which[:, np.newaxis], np.nan, orientations)
    return replace(campaign, poses=replace(campaign.poses, orientations=kept))


def excluded_part(run: IteratedAdjustment, at: int) -> str:
    """Say which part of an excluded pose contradicts the others."""
    position, orientation = run.statistics.w_position, run.statistics.w_orientation
    if np.isnan(position[at]) or orientation[at] < run.critical:
        return "position"
    return "position and orientation"
