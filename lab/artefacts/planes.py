"""What touching planes has in common: an attitude that turns, and its start."""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import across

ATTITUDE_SCALE_RAD = 1.0
HEIGHT_SCALE_MM = 1000.0
_STEPS = 10


def tangent_basis(normal: Floats) -> Floats:
    """Make two unit vectors across a unit vector, (2, 3)."""
    return np.stack(across(normal))


def turned_normal(normal: Floats, step: Floats) -> Floats:
    """Move a unit vector by two components in its tangent basis."""
    moved = normal + step @ tangent_basis(normal)
    turned: Floats = moved / np.linalg.norm(moved)
    return turned


def start_normal(centres_mm: Floats, groups: Floats) -> Floats:
    """Fit the common normal of parallel planes, robustly.

    Args:
        centres_mm: (n_poses, 3).
        groups: Which plane each pose lies in, (n_poses,).

    Returns:
        A unit vector; its sign means nothing.
    """
    weights = np.ones(len(centres_mm))
    normal = np.array([0.0, 0.0, 1.0])
    for _ in range(_STEPS):
        local_mm = np.zeros_like(centres_mm)
        for group in np.unique(groups):
            mine = groups == group
            mean_mm = np.average(centres_mm[mine], axis=0, weights=weights[mine])
            local_mm[mine] = centres_mm[mine] - mean_mm
        spread = (weights[:, np.newaxis] * local_mm).T @ local_mm
        normal = np.linalg.eigh(spread)[1][:, 0]
        heights_mm = np.abs(local_mm @ normal)
        scale_mm = max(3.0 * float(np.median(heights_mm)), 1e-9)
        weights = 1.0 / (1.0 + (heights_mm / scale_mm) ** 2)
    return normal
