"""Spreads points evenly."""

import numpy as np

from traverse.arrays import Floats


def crossed(normal: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors that span the plane across a unit vector (3,)."""
    other = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = other - (other @ normal) * normal
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def unit(vector: tuple[float, float, float]) -> Floats:
    """The direction of a vector."""
    whole = np.array(vector, dtype=np.float64)
    direction: Floats = whole / np.linalg.norm(whole)
    return direction


def cap_directions(pole: Floats, opening_rad: float, n_points: int) -> Floats:
    """Unit vectors (n, 3) within an angle of the pole, on a golden spiral."""
    heights = np.linspace(1.0, np.cos(opening_rad), n_points)
    around = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n_points)
    radii = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    first, second = crossed(pole)
    directions: Floats = (
        (radii * np.cos(around))[:, None] * first
        + (radii * np.sin(around))[:, None] * second
        + heights[:, None] * pole
    )
    return directions
