"""A sphere: centre unknown, radius known or not (the paper's case d).

w = |x - c| - R (1 + growth) - r outside, + r inside
"""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import (
    EXACT_MM,
    REFERENCE_TEMPERATURE_C,
    Artefact,
    Certificate,
    Equations,
    Length,
    Touches,
)
from traverse.lab.artefacts.spheres import (
    PLACE_SCALE_MM,
    RADIUS_SCALE_MM,
    distances,
    offset_sign,
    start_centre,
)


class Sphere(Artefact):
    """A ball or a bowl; state: centre and radius."""

    kind: Literal["sphere"]
    radius_mm: float | None = Field(default=None, gt=0.0)
    radius_std_mm: float | None = Field(default=None, gt=0.0)
    side: Literal["outside", "inside"] = "outside"
    expansion_per_c: float = 0.0
    reference_temperature_c: float = REFERENCE_TEMPERATURE_C

    def tells_length(self, touches: Touches) -> bool:
        """Say that a known radius is a length."""
        return self.radius_mm is not None

    def unknown_scales(self, touches: Touches) -> Floats:
        """Centre and radius."""
        return np.array([PLACE_SCALE_MM] * 3 + [RADIUS_SCALE_MM])

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Fit a sphere."""
        offset_mm = offset_sign(self.side) * touches.radius_mm
        known_mm = None if self.radius_mm is None else self.radius_mm + offset_mm
        centre_mm, radius_mm = start_centre(centres_mm, known_mm)
        return np.append(centre_mm, radius_mm - offset_mm)

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = |x - c| - R (1 + growth) -+ r."""
        distances_mm, units = distances(centres_mm, state[:3])
        growths = 1.0 + touches.growths
        offset_mm = offset_sign(self.side) * touches.radius_mm
        misclosures_mm = distances_mm - state[3] * growths - offset_mm
        return Equations(
            misclosures_mm[:, np.newaxis],
            units[:, np.newaxis, :],
            np.column_stack([-units, -growths])[:, np.newaxis, :],
        )

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        """The radius, where it is known."""
        if self.radius_mm is None:
            return super().certificate(state, touches)
        return Certificate(
            np.array([state[3] - self.radius_mm]),
            np.array([[0.0, 0.0, 0.0, 1.0]]),
            np.array([self.radius_std_mm or EXACT_MM]),
        )

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        """The radius."""
        row = None if self.radius_mm is None else 0
        by_unknowns = np.array([0.0, 0.0, 0.0, 1.0])
        return (Length("radius_mm", float(state[3]), by_unknowns, row),)
