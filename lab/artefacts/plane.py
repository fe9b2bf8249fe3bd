"""A plane of unknown attitude (the paper's case d).

State: the unit normal n, out of the material, and the height d of the surface.

    w = n . x - d - r, with - r replaced by + r where the direction of touch says
    that the ball was on the other side
"""

from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import Artefact, Equations, Touches
from traverse.lab.artefacts.planes import (
    ATTITUDE_SCALE_RAD,
    HEIGHT_SCALE_MM,
    start_normal,
    tangent_basis,
    turned_normal,
)


class Plane(Artefact):
    """A flat surface; without directions all balls are taken to be on one side."""

    kind: Literal["plane"]

    def unknown_scales(self, touches: Touches) -> Floats:
        """Attitude and height."""
        return np.array([ATTITUDE_SCALE_RAD] * 2 + [HEIGHT_SCALE_MM])

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Fit a plane; the directions of touch tell where its outside is."""
        normal = start_normal(centres_mm, np.zeros(len(centres_mm)))
        if np.nansum(touches.directions @ normal) > 0.0:
            normal = -normal
        sides = _sides(normal, touches)
        if np.ptp(sides) > 0.0:
            # Touched from both sides: two planes of centres, a ball apart.
            refined = start_normal(centres_mm, sides)
            normal = refined * np.sign(refined @ normal)
        sides_mm = _sides(normal, touches) * touches.radius_mm
        return np.append(normal, np.median(centres_mm @ normal - sides_mm))

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = n . x - d -+ r."""
        normal = state[:3]
        sides_mm = _sides(normal, touches) * touches.radius_mm
        misclosures_mm = centres_mm @ normal - state[3] - sides_mm
        by_unknowns = np.column_stack(
            [centres_mm @ tangent_basis(normal).T, -np.ones(len(centres_mm))]
        )
        return Equations(
            misclosures_mm[:, np.newaxis],
            np.broadcast_to(normal, (len(centres_mm), 1, 3)),
            by_unknowns[:, np.newaxis, :],
        )

    def moved(self, state: Floats, step: Floats) -> Floats:
        """Turn the normal, shift the height."""
        return np.append(turned_normal(state[:3], step[:2]), state[3] + step[2])


def _sides(normal: Floats, touches: Touches) -> Floats:
    """Say on which side of the surface each ball was, +1 along the normal."""
    inwards = touches.directions @ normal
    return np.where(inwards > 0.0, -1.0, 1.0)
