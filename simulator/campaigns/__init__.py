"""Simulated identification campaigns, by the simulator's own physics."""

from simulator.campaigns.artefacts import (
    Artefact,
    BallBar,
    Cone,
    ParallelPlanes,
    Plane,
    Points,
    Sphere,
)
from simulator.campaigns.campaign import (
    Blunder,
    Campaign,
    SimulatedCampaign,
    StatedArtefact,
    Truth,
)
from simulator.campaigns.drawing import draw_noise, simulate_campaign
from simulator.campaigns.mixes import MIXES
from simulator.campaigns.pose_set import PlacedArtefact, PoseSet
from simulator.campaigns.poses import make_poses
from simulator.campaigns.siting import UnreachableError
from simulator.campaigns.spec import (
    CampaignFile,
    CampaignSpec,
    ConditionTable,
    NoiseTable,
)
from simulator.campaigns.with_effects import with_effects
from simulator.campaigns.writing import true_arm_file, write_campaign

__all__ = [
    "MIXES",
    "Artefact",
    "BallBar",
    "Blunder",
    "Campaign",
    "CampaignFile",
    "CampaignSpec",
    "ConditionTable",
    "Cone",
    "NoiseTable",
    "ParallelPlanes",
    "PlacedArtefact",
    "Plane",
    "Points",
    "PoseSet",
    "SimulatedCampaign",
    "Sphere",
    "StatedArtefact",
    "Truth",
    "UnreachableError",
    "draw_noise",
    "make_poses",
    "simulate_campaign",
    "true_arm_file",
    "with_effects",
    "write_campaign",
]
