"""Where surfaces were touched in a stream, as far as an artefact's shape tells it."""

from dataclasses import replace

import numpy as np

from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.network import Network, State
from traverse.lab.identification.equations.station_equations import station_centres


def with_surface_directions(
    campaign: Campaign, network: Network, state: State
) -> Campaign:
    """Say where spheres were touched: from the ball towards the material.

    Args:
        campaign: A whole stream.
        network: Of all its samples.
        state: Of a fit.
    """
    directions = np.full((len(campaign.poses), 3), np.nan)
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        if not isinstance(station.artefact, Sphere | BallBar):  # no side is known
            continue
        balls_mm = station_centres(network, station, state.arm)
        centres_mm, sense = unknowns[:3], 1.0
        if isinstance(station.artefact, BallBar):
            places_mm = unknowns[:6].reshape(2, 3)
            centres_mm = places_mm[campaign.poses.features[station.poses]]
        elif station.artefact.side == "inside":
            sense = -1.0
        away_mm = sense * (centres_mm - balls_mm)
        lengths_mm = np.linalg.norm(away_mm, axis=1, keepdims=True)
        directions[station.poses] = away_mm / np.maximum(lengths_mm, 1e-9)
    if not np.any(np.isfinite(directions)):
        return campaign
    return replace(campaign, poses=replace(campaign.poses, directions=directions))
