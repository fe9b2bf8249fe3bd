"""Orientations that contradict the rest, while the positions of their poses agree.

A pose is tested as a whole. Where it is excluded although its position alone agrees
with the others, its orientation is taken out instead, and the pose takes part again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment import ArmValues, IteratedAdjustment, Network
from traverse.lab.campaign.campaign import Campaign

_MOST_ROUNDS = 6
# No arm is so far from its file, in the median, and an inverse rotation agrees better.
_LARGE_RAD = 0.3
_BETTER = 0.3


@dataclass(frozen=True, slots=True)
class WrongOrientation:
    """An orientation that took no part: the line of its pose, and its |w|."""

    line: int
    w: float


def without_wrong_orientations(
    campaign: Campaign,
    run: IteratedAdjustment,
    adjusted: Callable[[Campaign], IteratedAdjustment],
) -> tuple[Campaign, IteratedAdjustment, tuple[WrongOrientation, ...]]:
    """Take out orientations that contradict the rest, until none does.

    Returns the campaign without them, its adjustment, and what was taken out, by line.
    """
    excluded: list[WrongOrientation] = []
    for _ in range(_MOST_ROUNDS):
        wrong = run.contradicted_by_orientation()
        if not np.any(wrong):
            break
        lines, w = campaign.poses.lines[wrong], run.statistics.w_orientation[wrong]
        excluded += map(WrongOrientation, lines.tolist(), w.tolist())
        campaign = campaign.without_orientations(wrong)
        run = adjusted(campaign)
    return campaign, run, tuple(sorted(excluded, key=lambda entry: entry.line))


def are_inverse(network: Network, arm: ArmValues, unknowns: Sequence[Floats]) -> bool:
    """Return whether orientations contradict an arm, and their inverses do not.

    The unknowns are of each station.
    """
    medians_rad = []
    for signs in (np.ones(4), np.array([1.0, -1.0, -1.0, -1.0])):
        turned = tuple(
            replace(station, touches=replace(touches, orientations=signs * seen))
            if (seen := touches.orientations) is not None
            else station
            for station in network.stations
            for touches in [station.touches]
        )
        of_inverse = replace(network, stations=turned)
        mounted = replace(arm, mountings=of_inverse.fitted_mountings(arm, unknowns))
        errors_rad = [
            network.orientation_errors_rad(station, mounted, of_station)
            for station, of_station in zip(turned, unknowns, strict=True)
        ]
        sizes_rad = np.linalg.norm(np.concatenate(errors_rad), axis=1)
        medians_rad.append(float(np.nanmedian(sizes_rad)))
    as_given, turned_round = medians_rad
    return as_given > _LARGE_RAD and turned_round < _BETTER * as_given
