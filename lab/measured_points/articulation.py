"""One place touched in many postures: how far the touches scatter about it."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.measured_points.measurement import ArtefactTouches


@dataclass(frozen=True, slots=True)
class Articulation:
    """Touches of a cone's seat: delta_i = |p_i - mean|.

    Attributes:
        mean_mm: (3,)
        delta_mm: (n,)
    """

    mean_mm: Floats
    delta_mm: Floats

    @property
    def largest_mm(self) -> float:
        """Give max delta_i."""
        return float(self.delta_mm.max())

    @property
    def two_s_mm(self) -> float:
        """Give 2 s, s = sqrt(sum delta_i^2 / (n - 1))."""
        squares_mm2 = float(self.delta_mm @ self.delta_mm)
        return 2.0 * float(np.sqrt(squares_mm2 / (len(self.delta_mm) - 1)))


def articulation_of(touched: ArtefactTouches) -> Articulation:
    """Take touches of one seat, two or more."""
    mean_mm = touched.places_mm.mean(axis=0)
    delta_mm = np.linalg.norm(touched.places_mm - mean_mm, axis=1)
    return Articulation(mean_mm, delta_mm)
