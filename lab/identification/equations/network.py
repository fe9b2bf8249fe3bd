"""The network of observations: every artefact with the poses that touched it.

The stochastic model: how well encoders read and how well contacts repeat.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.artefacts.artefact import Artefact, Touches
from traverse.lab.campaign.campaign import Campaign, Poses
from traverse.lab.identification.equations.parameters import ArmValues, Parameters

DEFAULT_ENCODER_RAD = 5e-6
DEFAULT_CONTACT_MM = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Standard deviations.

    Attributes:
        encoder_rad: Of every joint's reading, (n_joints,).
        contact_mm: Of a contact with every artefact, along each axis, (n_artefacts,).
    """

    encoder_rad: Floats
    contact_mm: Floats


def a_priori_noise(campaign: Campaign) -> Noise:
    """Take the campaign's noise, or usual figures where it has none."""
    encoder_rad = campaign.encoder_rad or DEFAULT_ENCODER_RAD
    contact_mm = campaign.contact_mm or DEFAULT_CONTACT_MM
    return Noise(
        np.full(len(campaign.joint_names), encoder_rad),
        np.full(len(campaign.artefacts), contact_mm),
    )


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
        return len(self.poses) * self.artefact.rows_per_pose

    def part(self, rows: Integers) -> "Station":
        """Take some of the poses."""
        return replace(self, poses=self.poses[rows], touches=self.touches.part(rows))


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Everything that is estimated.

    Attributes:
        unknowns: Of each station.
        corrections: Of the readings [rad] and of the contact [mm] of each station's
            poses, where the equations are linearised, (n_poses, n_joints + 3).
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


def stations(
    campaign: Campaign, radius_mm: float, included: Booleans
) -> tuple[Station, ...]:
    """Sort the included poses by artefact, and then by tool.

    Artefacts without any are left out.
    """
    poses = campaign.poses
    tools = np.zeros(len(poses)) if poses.tools is None else poses.tools
    order = np.lexsort((tools, poses.artefacts))
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


def network_of(
    campaign: Campaign,
    radius_mm: float,
    included: Booleans,
    parameters: Parameters,
    noise: Noise | None = None,
) -> Network:
    """Set up some poses of a campaign, all of the same weight.

    Args:
        campaign: All poses.
        radius_mm: Of the probe's ball.
        included: Poses that take part, (n_poses,).
        parameters: Which parameters are free.
        noise: The stochastic model; default: the a priori one.
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

    Args:
        poses: All of the campaign, or some.
        arm: With the vectors of its tools.
        compute: From the arm with a tool and the indices of its poses, (n,), to a row
            a pose.
    """
    if poses.tools is None or not len(poses):
        return compute(arm.geometry, np.arange(len(poses)))
    order = np.argsort(poses.tools, kind="stable")
    parts = [
        compute(arm.with_tool(int(tool)).geometry, np.flatnonzero(poses.tools == tool))
        for tool in np.unique(poses.tools)
    ]
    found: Floats = np.concatenate(parts)[np.argsort(order)]
    return found


def has_length(network: Network) -> bool:
    """Return whether anything determines the scale."""
    return any(
        station.artefact.fixes_scale(station.touches) for station in network.stations
    )
