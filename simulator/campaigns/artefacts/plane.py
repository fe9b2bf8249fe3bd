"""Plane: of unknown attitude, touched from one side."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats, Indices
from traverse.simulator.campaigns.artefacts.artefact import Artefact, Contacts, Table
from traverse.simulator.campaigns.artefacts.placement import Placement


class Plane(Artefact):
    """A square plate.

    Attributes:
        size_mm: Side of the square.
    """

    kind: Literal["plane"] = "plane"
    size_mm: float = Field(gt=0.0)

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """Spread evenly; the plate's outer normal is the third axis."""
        centres_mm = np.full((len(features), 3), ball_mm)
        half_mm = 0.5 * self.size_mm
        centres_mm[:, :2] = rng.uniform(-half_mm, half_mm, (len(features), 2))
        return Contacts(centres_mm, np.tile([0.0, 0.0, -1.0], (len(features), 1)))

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Nothing is known of it."""
        return {}

    def true_table(self, placement: Placement) -> Table:
        """Outer normal, and its product with any point of the plane."""
        normal = placement.rotation[:, 2]
        return {
            "normal": normal.tolist(),
            "offset_mm": float(normal @ placement.position_mm),
        }
