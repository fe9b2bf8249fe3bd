"""Plausibility of a touch, by others of the same place."""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.shapes import fit_sphere

PLAUSIBLE_MM = 5.0
"""Larger than the error of any arm: such a touch is of another place."""
FEWEST_ON_SPHERE = 5


def off_seat(points_mm: Floats, others_mm: Floats) -> Floats:
    """Compute distances from the median of others, (n_points,) in mm.

    Args:
        points_mm: in question, (n_points, 3).
        others_mm: of the same seat, (n_others, 3); perhaps none.
    """
    if not len(others_mm):
        return np.zeros(len(points_mm))
    distances: Floats = np.linalg.norm(points_mm - np.median(others_mm, axis=0), axis=1)
    return distances


def off_sphere(
    points_mm: Floats, others_mm: Floats, widest_mm: float | None = None
) -> Floats:
    """Compute distances from the sphere of others, (n_points,) in mm.

    Args:
        points_mm: in question, (n_points, 3).
        others_mm: of the same sphere, (n_others, 3); perhaps too few.
        widest_mm: largest possible distance between two, or None.
    """
    off = np.zeros(len(points_mm))
    if widest_mm is not None and len(others_mm):
        between = np.linalg.norm(points_mm[:, np.newaxis] - others_mm, axis=2)
        off = np.maximum(off, between.max(axis=1) - widest_mm)
    try:
        sphere = fit_sphere(others_mm) if len(others_mm) >= FEWEST_ON_SPHERE else None
    except ValueError:
        sphere = None
    if sphere is not None:
        radii = np.linalg.norm(points_mm - sphere.centre_mm, axis=1)
        off = np.maximum(off, np.abs(radii - sphere.radius_mm))
    return off
