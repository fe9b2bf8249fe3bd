"""How far every joint turned in a campaign, and how evenly."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Integers
from traverse.lab.campaign.campaign import Campaign

_N_SECTORS = 36
# Below this travel a joint is blamed for what cannot be told.
_SMALL_TRAVEL_RAD = np.radians(20.0)


@dataclass(frozen=True, slots=True, eq=False)
class JointCoverage:
    """Where a joint has been.

    Attributes:
        joint: Its name.
        least_rad: The smallest reading.
        largest_rad: The largest one.
        sectors: Poses in each of 36 sectors of a turn, from reading 0 on, (36,).
    """

    joint: str
    least_rad: float
    largest_rad: float
    sectors: Integers

    @property
    def travel_rad(self) -> float:
        """From the smallest to the largest reading."""
        return self.largest_rad - self.least_rad

    @property
    def hardly_turned(self) -> bool:
        """Whether to turn it further is the first thing to advise."""
        return bool(self.travel_rad < _SMALL_TRAVEL_RAD)

    @property
    def part_of_turn(self) -> float:
        """Sectors of the turn that have been visited, 0 to 1."""
        return float(np.count_nonzero(self.sectors)) / _N_SECTORS


def joint_coverage(campaign: Campaign, poses: Integers) -> tuple[JointCoverage, ...]:
    """Say where every joint has been in some poses."""
    found = []
    for k, name in enumerate(campaign.joint_names):
        angles_rad = campaign.poses.angles_rad[poses, k]
        turns = np.mod(angles_rad / (2.0 * np.pi), 1.0)
        sectors = np.minimum((turns * _N_SECTORS).astype(np.int64), _N_SECTORS - 1)
        counts = np.bincount(sectors, minlength=_N_SECTORS)
        found.append(
            JointCoverage(
                name, float(angles_rad.min()), float(angles_rad.max()), counts
            )
        )
    return tuple(found)
