"""Joint limits, about the base posture."""

from collections.abc import Mapping

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.simulator.arm.physics import Mechanism

# Largest turns of rolls and of hinges, in degrees.
TRAVELS_DEG: Mapping[str, tuple[float, float]] = {
    "full": (180.0, 180.0),
    "wide": (150.0, 75.0),
    "narrow": (60.0, 40.0),
}
ALONG = 0.7  # cosine from which on a joint turns about the element that it carries


def travel_limits(mechanism: Mechanism, travel: str) -> Floats:
    """Least and largest turns (n_joints, 2) by the name of a travel.

    A roll turns about the element that it carries, a hinge folds it.
    """
    roll_rad, hinge_rad = np.deg2rad(TRAVELS_DEG[travel])
    largest = np.where(_rolls(mechanism), roll_rad, hinge_rad)
    return np.stack([-largest, largest], axis=1)


def _rolls(mechanism: Mechanism) -> Booleans:
    """Which joints (n_joints,) are rolls; one without length does not show it."""
    ends_mm = np.vstack([mechanism.origins_mm[1:], mechanism.probe_mm])
    rolls = np.zeros(mechanism.n_joints, dtype=bool)
    for k, axis in enumerate(mechanism.axes):
        elements_mm = ends_mm[k:] - mechanism.origins_mm[k]
        lengths_mm = np.linalg.norm(elements_mm, axis=1)
        long = np.flatnonzero(lengths_mm > 1.0)
        if len(long):
            along_mm = abs(float(axis @ elements_mm[long[0]]))
            rolls[k] = along_mm > ALONG * lengths_mm[long[0]]
    return rolls
