"""Simulated identification campaigns, by the simulator's own physics."""

from traverse.simulator.campaigns.artefacts import (
    Artefact,
    BallBar,
    Cone,
    DrawWire,
    ParallelPlanes,
    Plane,
    Points,
    Seats,
    Sphere,
)
from traverse.simulator.campaigns.campaign import (
    Blunder,
    Campaign,
    SimulatedCampaign,
    StatedArtefact,
    Truth,
)
from traverse.simulator.campaigns.drawing import draw_noise, simulate_campaign
from traverse.simulator.campaigns.pose_set import PlacedArtefact, PoseSet, with_effects
from traverse.simulator.campaigns.poses import make_poses
from traverse.simulator.campaigns.siting import UnreachableError
from traverse.simulator.campaigns.spec import (
    MIXES,
    CampaignFile,
    CampaignSpec,
    ConditionTable,
    NoiseTable,
)
from traverse.simulator.campaigns.writing import true_arm_file, write_campaign

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
    "DrawWire",
    "NoiseTable",
    "ParallelPlanes",
    "PlacedArtefact",
    "Plane",
    "Points",
    "PoseSet",
    "Seats",
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
