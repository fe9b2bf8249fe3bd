"""Further contacts that a campaign could have: random postures on its artefacts."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.campaign.campaign import Poses
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.identification.design.artefact_postures import reached
from traverse.lab.identification.equations.network import State, stations
from traverse.lab.identification.solve.adjustment import Adjustment, adjust


def further_contacts(
    adjustment: Adjustment, n_tries: int, seed: int, wider_rad: Floats
) -> Poses:
    """Draw postures that touch the fit's artefacts.

    What else a pose says (time, temperature, motion, force) is taken from a random
    pose of the same artefact; the direction of a surface is its normal.

    Args:
        adjustment: The fit: where artefacts stand, which poses took part.
        n_tries: Of every artefact; those that do not reach it fall away.
        seed: Of the postures.
        wider_rad: By how much each joint may go beyond either end of what it has
            travelled, (n_joints,).
    """
    rng = np.random.default_rng(seed)
    network = adjustment.network
    taken = np.concatenate([station.poses for station in network.stations])
    travelled_rad = network.campaign.poses.angles_rad[taken]
    limits_rad = np.stack(
        [travelled_rad.min(axis=0) - wider_rad, travelled_rad.max(axis=0) + wider_rad]
    )
    found = [
        _contacts(adjustment, at, limits_rad, n_tries, rng)
        for at in range(len(network.stations))
    ]
    return joined_poses(found, network.campaign.poses)


def joined_poses(parts: list[Poses], like: Poses) -> Poses:
    """Put poses one after the other, with the columns that `like` has."""
    columns: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Poses)
        if getattr(like, field.name) is not None
    }
    return Poses(**columns)


def extended_rows(adjustment: Adjustment, further: Poses) -> ObservationEquations:
    """Set up the rows of a fit, where it is, as if further poses had taken part.

    The campaign's own poses come first.
    """
    network = adjustment.network
    n_own = len(network.campaign.poses)
    poses = joined_poses([network.campaign.poses, further], network.campaign.poses)
    campaign = replace(network.campaign, poses=poses)
    included = np.zeros(len(poses), dtype=np.bool_)
    included[n_own:] = True
    for station in network.stations:
        included[station.poses] = True
    radius_mm = network.stations[0].touches.radius_mm
    everyone = stations(campaign, radius_mm, included)
    weights = np.ones(len(poses))
    wider = replace(network, campaign=campaign, stations=everyone, weights=weights)
    n_corrected = network.parameters.n_joints + 3
    nothing = tuple(np.zeros((len(s.poses), n_corrected)) for s in everyone)
    state = State(adjustment.state.arm, adjustment.state.unknowns, nothing)
    return equations_of(adjust(wider, state, state.arm, None, 0))


def _contacts(
    adjustment: Adjustment,
    at: int,
    limits_rad: Floats,
    n_tries: int,
    rng: np.random.Generator,
) -> Poses:
    network, state = adjustment.network, adjustment.state
    station, geometry = network.stations[at], state.arm.geometry
    least_rad, largest_rad = limits_rad
    like = rng.integers(len(station.poses), size=n_tries)
    part = station.part(like)
    tries_rad = rng.uniform(least_rad, largest_rad, (n_tries, len(least_rad)))
    came = reached(part.artefact, state.unknowns[at], part.touches, geometry, tries_rad)
    angles_rad = came.angles_rad
    good = came.is_touching & np.all(
        (angles_rad >= least_rad) & (angles_rad <= largest_rad), axis=1
    )
    poses = network.campaign.poses.part(part.poses)
    poses = replace(poses, angles_rad=angles_rad)
    if poses.directions is not None and part.artefact.rows_per_pose == 1:
        normals = came.equations.by_centre[:, 0]
        before = station.artefact.equations(
            state.unknowns[at],
            probe_centre(geometry, network.campaign.poses.angles_rad[station.poses]),
            station.touches,
        ).by_centre[like, 0]
        along = np.sum(before * poses.directions, axis=1, keepdims=True)
        poses = replace(poses, directions=np.sign(along) * normals)
    return poses.part(good)
