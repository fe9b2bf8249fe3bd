"""Poses that are kept aside, chosen before anything is looked at.

Of each artefact about three poses in ten, in whole groups that are contiguous in
time: neighbours share what changes slowly, so single poses between their neighbours
would be predicted too well.
"""

from zlib import crc32

import numpy as np

from traverse.arrays import Booleans, Integers
from traverse.lab.campaign.campaign import Campaign

PART = 0.3
# Poses of a group, and how many groups an artefact is cut into where it has enough.
_LEAST_SIZE, _LARGEST_SIZE, _GROUPS = 3, 20, 10
# Equations that stay beyond the unknowns they are needed for: of an artefact, and of
# the arm, where fewer could not tell effects from noise.
_SPARE_ROWS, LEAST_REDUNDANCY = 2, 10
# Kinds whose features have unknowns of their own.
_OWN_FEATURES = ("ball_bar", "parallel_planes", "seats")
_UNKNOWNS_A_JOINT = 4


def split(
    campaign: Campaign, seed: int, part: float = PART
) -> tuple[Booleans, Booleans]:
    """Choose the poses for choosing and those that are held out, (n_poses,) each.

    It depends on the poses, not on their order in the file. An artefact that cannot
    spare any gives none; nor does a campaign whose rest would not determine the arm.
    The part is of the poses of each artefact, above 0 and below 1.
    """
    held_out = np.zeros(len(campaign.poses), dtype=np.bool_)
    n_left = -_UNKNOWNS_A_JOINT * len(campaign.joint_names) - LEAST_REDUNDANCY
    for index, artefact in enumerate(campaign.artefacts):
        poses = _in_time(campaign, index)
        if len(poses) == 0:
            continue
        rng = np.random.default_rng([seed, crc32(artefact.id.encode())])
        held_out[_given_away(campaign, index, poses, part, rng)] = True
        n_kept = len(poses) - int(np.count_nonzero(held_out[poses]))
        n_left += n_kept * artefact.rows_per_pose - _n_unknowns(campaign, index, poses)
    if n_left < 0:
        held_out[:] = False
    return ~held_out, held_out


def split_artefacts(
    campaign: Campaign, seed: int, part: float = PART
) -> tuple[Booleans, Booleans]:
    """Choose whole artefacts that are held out, as `split`; one at least is kept."""
    touched = campaign.poses.artefacts
    indices, counts = np.unique(touched, return_counts=True)
    held_out = np.zeros(len(touched), dtype=np.bool_)
    n_held_out = 0
    for index in np.random.default_rng(seed).permutation(len(indices))[:-1]:
        # An artefact that would overshoot more than there lacks now stays.
        if n_held_out == 0 or n_held_out + 0.5 * counts[index] <= part * len(touched):
            held_out |= touched == indices[index]
            n_held_out += int(counts[index])
    return ~held_out, held_out


MOST_CHOOSING = 2000
"""Poses that choose, at most: time and memory of a search grow with them."""


def at_most(campaign: Campaign, choosing: Booleans, seed: int) -> Booleans:
    """Choose so many of the choosing poses, of all artefacts alike, (n_poses,).

    At random, so that any covariate is sampled as it was; the others take part in the
    last estimates only.
    """
    n = int(np.count_nonzero(choosing))
    if n <= MOST_CHOOSING:
        return choosing
    rng = np.random.default_rng(seed)
    held_out = np.zeros_like(choosing)
    artefacts = campaign.poses.artefacts
    for index in np.unique(artefacts[choosing]):
        mine = np.flatnonzero(choosing & (artefacts == index))
        n_chosen = max(len(mine) * MOST_CHOOSING // n, min(len(mine), _LARGEST_SIZE))
        held_out[rng.permutation(mine)[:n_chosen]] = True
    return held_out


SPLITS = {"time": split, "artefact": split_artefacts}
"""How poses are held out, by the name of the way."""


def _given_away(
    campaign: Campaign,
    index: int,
    poses: Integers,
    part: float,
    rng: np.random.Generator,
) -> Integers:
    """Choose groups of an artefact's poses, in the order of time."""
    size = min(max(len(poses) // _GROUPS, _LEAST_SIZE), _LARGEST_SIZE)
    groups = np.array_split(poses, max(len(poses) // size, 1))
    n_wanted = part * len(poses)
    held_out: list[Integers] = []
    n_given = 0
    for at in rng.permutation(len(groups)):
        group = groups[at]
        # A group that would overshoot more than it lacks now stays.
        if n_given + 0.5 * len(group) > n_wanted:
            break
        trial = np.concatenate([*held_out, group])
        if _can_spare(campaign, index, poses, trial):
            held_out.append(group)
            n_given += len(group)
    return np.concatenate(held_out) if held_out else poses[:0]


def _can_spare(
    campaign: Campaign, index: int, poses: Integers, poses_away: Integers
) -> bool:
    """Return whether the rest still determines the artefact, and each own feature."""
    artefact = campaign.artefacts[index]
    n_rows, n_unknowns = artefact.rows_per_pose, _n_unknowns(campaign, index, poses)
    kept = np.setdiff1d(poses, poses_away)
    if n_rows * len(kept) < n_unknowns + _SPARE_ROWS:
        return False
    if artefact.kind not in _OWN_FEATURES:
        return True
    features = campaign.poses.features
    needed = -(-n_unknowns // len(artefact.features)) + _SPARE_ROWS
    return all(
        n_rows * np.count_nonzero(features[kept] == feature) >= needed
        for feature in np.unique(features[poses_away])
    )


def _n_unknowns(campaign: Campaign, index: int, poses: Integers) -> int:
    # How many there are does not depend on the size of the ball.
    touches = campaign.touches(index, poses, 1.0)
    return len(campaign.artefacts[index].unknown_scales(touches))


def _in_time(campaign: Campaign, index: int) -> Integers:
    """Sort an artefact's poses by time; equal times by feature and readings."""
    mine = np.flatnonzero(campaign.poses.artefacts == index)
    poses = campaign.poses.part(mine)
    keys = (*poses.angles_rad.T[::-1], poses.features, poses.time_s)
    return mine[np.lexsort(keys)]
