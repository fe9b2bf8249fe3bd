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
