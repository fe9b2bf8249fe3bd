"""The arm and the poses that proofs and benchmarks measure with."""

from pathlib import Path

import traverse.cli
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.simulator.campaigns import CampaignSpec, PoseSet, make_poses
from traverse.simulator.campaigns.spec import NoiseTable


def demo_arm() -> Arm:
    """Read the arm of the demonstration: seven joints, about a metre long."""
    return read_arm(Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml")


def mix_poses(
    mix: str, n_poses: int, seed: int, travel: str = "wide", arm: Arm | None = None
) -> PoseSet:
    """Make exact contacts of a mix of artefacts."""
    spec = CampaignSpec.model_validate(
        {
            "mix": mix,
            "n_poses": n_poses,
            "travel": travel,
            "noise": NoiseTable(),
            "conditions": {"columns": ("direction",)},
        }
    )
    return make_poses(arm or demo_arm(), spec, seed)
