"""The network of observations: every artefact with the poses that touched it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment.noise import Noise, a_priori_noise
from traverse.lab.adjustment.parameters import ArmValues, Parameters
from traverse.lab.artefacts.artefact import Artefact, Touches
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """One artefact and the poses that touched it.

    Attributes:
        poses: Indices of the campaign's poses, (n_poses,).
        scales: Hopeless standard deviations of its unknowns, (n_unknowns,).
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


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Everything that is estimated.

    Attributes:
        unknowns: Of each station.
        corrections: Of the readings [rad], of the contact [mm] and, where there are
            orientations, of these [rad] of each station's poses, where the equations
            are linearised, (n_poses, n_joints + 3 or 6).
    """

    arm: ArmValues
    unknowns: tuple[Floats, ...]
    corrections: tuple[Floats, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """The adjustment problem: observations, parameters, noise.

    Attributes:
        weights: Factors of the weights of all the campaign's poses, (n_poses,); all
            ones, but for a robust start.
    """

    campaign: Campaign
    stations: tuple[Station, ...]
    parameters: Parameters
    noise: Noise
    weights: Floats

    @property
    def n_rows(self) -> int:
        """The number of condition equations."""
        return sum(station.n_rows for station in self.stations)

    def on(self, campaign: Campaign) -> "Network":
        """Take the same poses of a campaign with other columns."""
        effects = self.parameters.effects
        if effects is not None:
            effects = replace(effects, campaign=campaign)
        parameters = replace(self.parameters, effects=effects)
        return replace(self, campaign=campaign, parameters=parameters)

    @property
    def unknown_columns(self) -> tuple[slice, ...]:
        """Columns of each station's unknowns, behind those of the free parameters."""
        widths = [len(station.scales) for station in self.stations]
        ends = [*accumulate(widths, initial=self.parameters.n_free)]
        return tuple(slice(*ends) for ends in pairwise(ends))

    @property
    def poses(self) -> Integers:
        """The campaign's poses that take part, station by station."""
        none = np.empty(0, dtype=np.int64)
        return np.concatenate([none, *(station.poses for station in self.stations)])

    @property
    def included(self) -> Booleans:
        """Which of the campaign's poses take part, (n_poses,)."""
        return np.isin(np.arange(len(self.campaign.poses)), self.poses)


def stations(
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
    found = []
    for index, artefact in enumerate(campaign.artefacts):
        first, last = np.searchsorted(indices, (index, index + 1))
        if first == last:
            continue
        mine = order[first:last]
        touches = campaign.touches(index, mine, radius_mm)
        scales = artefact.unknown_scales(touches)
        found.append(Station(artefact, index, mine, touches, scales))
    return tuple(found)


def known_stations(
    network: Network,
    state: State,
    campaign: Campaign,
    radius_mm: float,
    included: Booleans,
) -> tuple[tuple[Station, ...], tuple[Floats, ...]]:
    """Sort the included poses as `stations`, and find the state of their artefacts.

    Artefacts that take no part in the network are left out.
    """
    unknowns = {
        station.index: own
        for station, own in zip(network.stations, state.unknowns, strict=True)
    }
    found = tuple(
        station
        for station in stations(campaign, radius_mm, included)
        if station.index in unknowns
    )
    return found, tuple(unknowns[station.index] for station in found)


def network_of(
    campaign: Campaign,
    radius_mm: float,
    included: Booleans,
    parameters: Parameters,
    noise: Noise | None = None,
) -> Network:
    """Set up the included poses of a campaign, (n_poses,), all of the same weight.

    The noise is by default the a priori one.
    """
    return Network(
        campaign,
        stations(campaign, radius_mm, included),
        parameters,
        noise or a_priori_noise(campaign),
        np.ones(len(campaign.poses)),
    )


def each_tool(
    poses: Poses, arm: ArmValues, compute: Callable[[Geometry, Integers], Floats]
) -> Floats:
    """Put together what is computed for the poses of each tool, (n_poses, ...).

    It is computed from the arm with a tool and the indices of its poses, (n,), a row a
    pose.
    """
    if poses.tools is None or not len(poses):
        return compute(arm.geometry, np.arange(len(poses)))
    order = np.argsort(poses.tools, kind="stable")
    parts = [
        compute(arm.with_tool(int(tool)).geometry, np.flatnonzero(poses.tools == tool))
        for tool in np.unique(poses.tools)
    ]
    return np.concatenate(parts)[np.argsort(order)]


def has_length(network: Network) -> bool:
    """Return whether anything determines the scale."""
    expected = network.parameters.expected
    if expected is not None and any(".link." in name for name in expected.names):
        return True
    return any(
        station.artefact.fixes_scale(station.touches) for station in network.stations
    )


def evenly(rows: Integers, most: int) -> Integers:
    """Take so many at most, from the first to the last."""
    places = np.linspace(0, len(rows) - 1, min(len(rows), most))
    return rows[places.astype(np.int64)]
