"""Harmonics of every joint's reading, up to an order that no library would list.

Orders that the sampling or the travelled range cannot hold apart look the same here
too; whoever judges the bank sees that in how alike they are.
"""

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.readings.encoder_eccentricity import (
    EncoderEccentricity,
)
from traverse.kinematics.effects.readings.encoder_harmonic import EncoderHarmonic
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.candidates.effect_factory import parameter_names
from traverse.lab.diagnosis.candidates.priors import column_scales
from traverse.lab.diagnosis.model.candidate import Bank, BankName, Candidate
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

HIGHEST_ORDER = 60


def harmonic_bank(rows: ObservationEquations) -> Bank:
    """Compute cos and sin of order times the reading, for every joint and order.

    Args:
        rows: Of the fit.

    Returns:
        Two columns a candidate in units of plausible amplitudes, whitened, (n_rows,
        2 * HIGHEST_ORDER * n_joints): joint by joint, from order 1, which is the
        eccentricity, upwards.
    """
    campaign = rows.adjustment.network.campaign
    orders = np.arange(1, HIGHEST_ORDER + 1)
    scales = np.array([_scale_rad(order, campaign) for order in orders.tolist()])
    phases_rad = rows.block.angles_rad[:, :, np.newaxis] * orders
    waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=3)
    waves *= scales[:, np.newaxis]
    columns = rows.by_readings[:, :, np.newaxis, np.newaxis] * waves[rows.poses]
    return Bank(
        tuple(
            _candidate(joint, order, scale_rad)
            for joint in campaign.joint_names
            for order, scale_rad in zip(orders.tolist(), scales.tolist(), strict=True)
        ),
        rows.decorrelated(columns.reshape(len(columns), -1)),
    )


def _scale_rad(order: int, campaign: Campaign) -> float:
    of = EncoderEccentricity if order == 1 else EncoderHarmonic
    wave = of(joints=slice(0, 1), values=(0.0, 0.0), order=order)
    return column_scales(wave, 2, campaign)[0]


def _candidate(joint: str, order: int, scale_rad: float) -> Candidate:
    kind = EncoderEccentricity.kind if order == 1 else EncoderHarmonic.kind
    told = None if order == 1 else order
    return Candidate(
        bank=BankName.HARMONIC,
        kind=kind,
        joint=joint,
        order=told,
        component=None,
        covariate=None,
        artefact=None,
        at_s=None,
        parameters=parameter_names(kind),
        scales=(scale_rad, scale_rad),
        log_prior=EFFECT_KINDS[kind].preference(joint, told),
        keys=() if told is None else (("order", told),),
    )
