"""Spread of points that should coincide, about their mean."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import checked_points


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Spread of points that should coincide, about their mean.

    Attributes:
        mean_mm: (3,).
        max_deviation_mm: Largest distance from the mean.
        rms_mm: Root mean square of the distances from the mean.
    """

    mean_mm: Floats
    max_deviation_mm: float
    rms_mm: float


def spread_about_mean(points_mm: Floats) -> Spread:
    """Return how points that should coincide do: (n_points, 3), at least one."""
    points_mm = checked_points(points_mm, at_least=1)
    mean_mm = points_mm.mean(axis=0)
    distances_mm = np.linalg.norm(points_mm - mean_mm, axis=1)
    rms_mm = float(np.sqrt(np.mean(np.square(distances_mm))))
    return Spread(mean_mm, float(distances_mm.max()), rms_mm)
