"""Simulated campaigns in memory, handed over to the lab.

The simulator and the lab share no values, so columns and certificates are handed over
here just as the files would say them.
"""

from datetime import datetime

import numpy as np

from traverse.lab.artefacts import artefact_from_table
from traverse.lab.artefacts.artefact import Artefact
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses
from traverse.simulator.campaigns import Campaign as SimulatedColumns

_FIRST_LINE = 2


def campaign_from_simulation(drawn: SimulatedColumns) -> Campaign:
    """Turn a simulated campaign into the lab's, every column included."""
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
        of_artefact = indices == index
        numbers = {name: number for number, name in enumerate(listed)}
        features[of_artefact] = [
            numbers[str(name)] for name in drawn.feature[of_artefact]
        ]
    start = drawn.start_utc
    approaches = drawn.approach
    return Campaign(
        artefacts=tuple(artefacts),
        feature_names=tuple(names),
        joint_names=drawn.joints,
        poses=Poses(
            lines=np.arange(drawn.n_poses) + _FIRST_LINE,
            time_s=drawn.time_s,
            artefacts=indices,
            features=features,
            angles_rad=drawn.readings_rad,
            temperature_c=drawn.temperature_c,
            approaches=None if approaches is None else approaches.astype(np.float64),
            speeds_rad_s=drawn.speed_rad_s,
            directions=drawn.direction,
            force_n=drawn.force_n,
            lengths_mm=drawn.length_mm,
            orientations=drawn.orientation,
        ),
        start_utc=None if start is None else datetime.fromisoformat(start),
        encoder_rad=drawn.encoder_rad,
        contact_mm=drawn.contact_mm,
        orientation_rad=drawn.orientation_rad,
    )
