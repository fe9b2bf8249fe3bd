"""Harmonics of every joint's reading, up to an order that no library would list.

Orders that the sampling or the travelled range cannot hold apart look the same here
too; their likeness shows this.
"""

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.readings.harmonics import (
    EncoderEccentricity,
    EncoderHarmonic,
)
from traverse.lab.diagnosis.model.candidate import (
    Bank,
    BankName,
    Candidate,
    candidate_of_kind,
)
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

HIGHEST_HARMONIC = 60


def harmonic_bank(rows: ObservationEquations) -> Bank:
    """Compute cos and sin of order times the reading, for every joint and order.

    Returns:
        Two columns a candidate in units of plausible amplitudes, whitened, (n_rows,
        2 * HIGHEST_HARMONIC * n_joints): joint by joint, from order 1, which is the
        eccentricity, upwards.
    """
    orders = np.arange(1, HIGHEST_HARMONIC + 1)
    candidates = tuple(
        _candidate(joint, order)
        for joint in rows.adjustment.network.campaign.joint_names
        for order in orders.tolist()
    )
    scales = np.array([one.scales for one in candidates[:HIGHEST_HARMONIC]])
    phases_rad = rows.block.angles_rad[:, :, np.newaxis] * orders
    waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=3) * scales
    columns = rows.by_readings[:, :, np.newaxis, np.newaxis] * waves[rows.poses]
    return Bank(candidates, rows.decorrelated(columns.reshape(len(columns), -1)))


def _candidate(joint: str, order: int) -> Candidate:
    kind = EncoderEccentricity.kind if order == 1 else EncoderHarmonic.kind
    scale_rad = EFFECT_KINDS[kind].plausible_size(order)
    fixed = {"order": None if order == 1 else order}
    return candidate_of_kind(BankName.HARMONIC, kind, joint, fixed, scale_rad)
