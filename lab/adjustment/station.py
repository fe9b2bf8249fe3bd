"""An artefact with the poses that touched it."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.lab.artefacts.artefact import Artefact, Touches
from traverse.lab.campaign.campaign import Campaign


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """One artefact and the poses that touched it.

    Attributes:
        poses: Indices of the campaign's poses, (n_poses,).
        scales: Uninformative prior standard deviations of its unknowns, (n_unknowns,).
    """

    artefact: Artefact
    index: int
    poses: Integers
    touches: Touches
    scales: Floats

    @property
    def n_rows(self) -> int:
        """The number of condition equations."""
        n_oriented = int(np.count_nonzero(self.touches.oriented))
        return len(self.poses) * self.artefact.rows_per_pose + 3 * n_oriented

    @property
    def most_rows(self) -> int:
        """The number of condition equations that a pose has at most."""
        is_oriented = self.touches.orientations is not None
        return self.artefact.rows_per_pose + (3 if is_oriented else 0)

    def part(self, rows: Integers) -> "Station":
        """Take some of the poses."""
        return replace(self, poses=self.poses[rows], touches=self.touches.part(rows))


def sorted_stations(
    campaign: Campaign, radius_mm: float, included: Booleans
) -> tuple[Station, ...]:
    """Sort the included poses by artefact, by tool, and orientations behind the others.

    Artefacts without any are left out.
    """
    poses = campaign.poses
    tools = np.zeros(len(poses)) if poses.tools is None else poses.tools
    order = np.lexsort((poses.oriented, tools, poses.artefacts))
    order = order[included[order]]
    indices = poses.artefacts[order]
    stations = []
    for index, artefact in enumerate(campaign.artefacts):
        first, last = np.searchsorted(indices, (index, index + 1))
        if first == last:
            continue
        mine = order[first:last]
        touches = campaign.touches(index, mine, radius_mm)
        scales = artefact.unknown_scales(touches)
        stations.append(Station(artefact, index, mine, touches, scales))
    return tuple(stations)
