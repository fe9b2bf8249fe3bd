"""Large simulated campaigns for timing: one set of poses, drawn again and again.

Postures repeat with other noise, which costs the adjustment what new ones would.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.handover import campaign_from_simulation
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.campaign.campaign import Campaign, Poses
from traverse.lab.identification.equations.datum import with_datum
from traverse.lab.identification.equations.network import (
    Network,
    State,
    a_priori_noise,
    stations,
)
from traverse.lab.identification.equations.parameters import ArmValues, arm_parameters
from traverse.lab.identification.equations.station_equations import start_state
from traverse.simulator.campaigns import CampaignSpec, draw_noise, make_poses

_MOST_DIFFERENT = 5000
_SCAN_RADIUS_MM = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What every method starts from.

    Attributes:
        network: Observations, free parameters, noise.
        start: The design, and the artefacts' unknowns that follow from it.
    """

    network: Network
    start: State


def large_campaign(kind: str, n_poses: int, seed: int = 1) -> Campaign:
    """Make a campaign.

    Args:
        kind: "mixed", five cones and a ball bar; or "scan", one sphere of known
            radius.
        n_poses: Of all artefacts; a multiple of 5 000 if larger than that.
        seed: Of the poses; draws count on from it.
    """
    n_draws = -(-n_poses // _MOST_DIFFERENT)
    n_different = n_poses // n_draws
    if n_different * n_draws != n_poses:
        raise ValueError(f"{n_poses} poses; expected a multiple of {_MOST_DIFFERENT}")
    ball = {"id": "ball", "kind": "sphere", "known": True, "n_poses": n_different}
    chosen: dict[str, object] = (
        {"mix": "cones+bar", "n_poses": n_different}
        if kind == "mixed"
        else {"artefacts": ({**ball, "radius_mm": _SCAN_RADIUS_MM},)}
    )
    spec = CampaignSpec.model_validate({**chosen, "conditions": {"columns": ()}})
    poses = make_poses(demo_arm(), spec, seed)
    drawn = [
        campaign_from_simulation(draw_noise(poses, seed + draw).campaign)
        for draw in range(n_draws)
    ]
    numbers = np.arange(n_poses)
    return replace(
        drawn[0],
        poses=Poses(
            lines=numbers + 2,
            time_s=numbers.astype(np.float64),
            artefacts=np.concatenate([part.poses.artefacts for part in drawn]),
            features=np.concatenate([part.poses.features for part in drawn]),
            angles_rad=np.concatenate([part.poses.angles_rad for part in drawn]),
        ),
    )


def problem(campaign: Campaign, arm: Arm) -> Problem:
    """Set up what `identify` adjusts first, with the noise that the campaign states."""
    geometry = geometry_from_arm(arm)
    parameters = arm_parameters(geometry, campaign.joint_names)
    n_poses = len(campaign.poses)
    network = Network(
        campaign,
        stations(campaign, arm.probe.radius_mm, np.ones(n_poses, dtype=np.bool_)),
        with_datum(parameters, geometry),
        a_priori_noise(campaign),
        np.ones(n_poses),
    )
    return Problem(network, start_state(network, ArmValues(geometry, np.empty(0))))
