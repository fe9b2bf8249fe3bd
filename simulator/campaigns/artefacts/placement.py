"""The placement of an artefact: its own coordinates into the arm's system."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats


@dataclass(frozen=True, slots=True)
class Placement:
    """A rigid motion.

    Attributes:
        rotation: (3, 3) its columns are the artefact's axes in the arm's system.
        position_mm: (3,) the artefact's origin in the arm's system.
    """

    rotation: Floats
    position_mm: Floats

    def points_mm(self, own_mm: Floats) -> Floats:
        """Points (n, 3) of the artefact in the arm's system."""
        return own_mm @ self.rotation.T + self.position_mm

    def directions(self, own: Floats) -> Floats:
        """Directions (n, 3) of the artefact in the arm's system."""
        return own @ self.rotation.T


def drawn_rotation(rng: np.random.Generator) -> Floats:
    """A rotation (3, 3), all alike probable: the axes of a random frame, righted."""
    frame, triangle = np.linalg.qr(rng.standard_normal((3, 3)))
    frame = frame * np.sign(np.diag(triangle))
    if np.linalg.det(frame) < 0.0:
        frame[:, 2] = -frame[:, 2]
    rotation: Floats = frame
    return rotation


def drawn_directions(
    rng: np.random.Generator, n_directions: int, opening_rad: float
) -> Floats:
    """Unit vectors (n, 3), even over the cap of that opening about the third axis."""
    heights = rng.uniform(np.cos(opening_rad), 1.0, n_directions)
    around = rng.uniform(-np.pi, np.pi, n_directions)
    radii = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    return np.stack([radii * np.cos(around), radii * np.sin(around), heights], axis=1)
