"""Random errors of readings and contacts, white or serially correlated."""

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.campaigns.spec import NoiseTable


def encoder_stds(noise: NoiseTable, n_joints: int) -> Floats:
    """Standard deviations (n_joints,) [rad]."""
    if noise.encoders_rad is None:
        return np.full(n_joints, noise.encoder_rad)
    return np.array(noise.encoders_rad, dtype=np.float64)


def contact_stds(noise: NoiseTable, poses: PoseSet) -> Floats:
    """Standard deviations (n,) [mm]; an artefact may have its own."""
    own = [placed.artefact.contact_mm for placed in poses.artefacts]
    stds_mm = np.array([noise.contact_mm if std is None else std for std in own])
    return stds_mm[poses.artefact_index]


def serial_noise(
    rng: np.random.Generator, n_rows: int, n_columns: int, noise: NoiseTable
) -> Floats:
    """Standard normal numbers (n_rows, n_columns), partly correlated along rows.

    sqrt(1 - share) white + sqrt(share) e with e_i = phi e_(i-1) + sqrt(1 - phi^2) w_i.
    """
    white = rng.standard_normal((n_rows, n_columns))
    share, phi = noise.serial_share, noise.serial_phi
    if share == 0.0:
        return white
    drifting = rng.standard_normal((n_rows, n_columns))
    fresh = np.sqrt(1.0 - phi**2)
    for row in range(1, n_rows):
        drifting[row] = phi * drifting[row - 1] + fresh * drifting[row]
    mixed: Floats = np.sqrt(1.0 - share) * white + np.sqrt(share) * drifting
    return mixed


def contact_shifts(poses: PoseSet, standard: Floats, stds_mm: Floats) -> Floats:
    """Displacements (n, 3): along the normal, in a seat in all directions.

    Args:
        poses: The contacts.
        standard: (n, 3) standard normal; the first serves along the normal.
        stds_mm: (n,)
    """
    seated = np.isnan(poses.towards[:, :1])
    along = standard[:, :1] * np.nan_to_num(poses.towards)
    shifts: Floats = stds_mm[:, None] * np.where(seated, standard, along)
    return shifts
