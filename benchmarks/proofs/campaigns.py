"""Simulated campaigns in memory, as the identification takes them.

The simulator and the lab share no values, so columns and certificates are handed over
here just as the files would say them.
"""

from pathlib import Path

import numpy as np

import traverse
from kinematics.arm_file import Arm, read_arm
from lab.campaign import Campaign, Poses
from lab.identification.artefacts import artefact_from_table
from lab.identification.artefacts.artefact import Artefact
from simulator.campaigns import Campaign as SimulatedColumns
from simulator.campaigns import CampaignSpec, PoseSet, make_poses
from simulator.campaigns.spec import NoiseTable

FIRST_LINE = 2


def demo_arm() -> Arm:
    """Read the arm of the demonstration: seven joints, about a metre long."""
    return read_arm(Path(traverse.__file__).parent / "demo_data" / "arm.toml")


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


def lab_campaign(drawn: SimulatedColumns) -> Campaign:
    """Hand a simulated campaign over to the lab."""
    artefacts, names = [], []
    for stated in drawn.artefacts:
        table = {"id": stated.id, "kind": stated.kind, **stated.table}
        artefact = artefact_from_table(table)
        if not isinstance(artefact, Artefact):
            raise TypeError(f"{stated.kind} '{stated.id}' became {type(artefact)}")
        artefacts.append(artefact)
        names.append(artefact.features or ("",))
    ids = {stated.id: index for index, stated in enumerate(drawn.artefacts)}
    indices = np.array([ids[str(name)] for name in drawn.artefact], dtype=np.int64)
    features = np.zeros(drawn.n_poses, dtype=np.int64)
    for index, listed in enumerate(names):
        mine = indices == index
        numbers = {name: number for number, name in enumerate(listed)}
        features[mine] = [numbers[str(name)] for name in drawn.feature[mine]]
    return Campaign(
        artefacts=tuple(artefacts),
        feature_names=tuple(names),
        joint_names=drawn.joints,
        poses=Poses(
            lines=np.arange(drawn.n_poses) + FIRST_LINE,
            time_s=drawn.time_s,
            artefacts=indices,
            features=features,
            angles_rad=drawn.readings_rad,
            temperature_c=drawn.temperature_c,
            directions=drawn.direction,
        ),
        encoder_rad=drawn.encoder_rad,
        contact_mm=drawn.contact_mm,
    )
