"""Parallel planes at a known distance: a gauge block or a gap, held at its middle."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats, Indices
from traverse.simulator.campaigns.artefacts.artefact import (
    Artefact,
    Contacts,
    Table,
    stated_expansion,
    stated_length,
)
from traverse.simulator.campaigns.artefacts.placement import Placement

INWARDS = -1.0


class ParallelPlanes(Artefact):
    """Two square faces, features 1 and 2.

    Attributes:
        distance_mm: True distance of the faces.
        distance_std_mm: Of the distance that the campaign states.
        size_mm: Side of the squares.
        side: Outside of a block or inside of a gap.
        expansion_per_c: Of the distance.
    """

    kind: Literal["parallel_planes"] = "parallel_planes"
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float = Field(default=0.0, ge=0.0)
    size_mm: float = Field(gt=0.0)
    side: Literal["outside", "inside"] = "outside"
    expansion_per_c: float = 0.0

    @property
    def features(self) -> tuple[str, ...]:
        """The two faces."""
        return ("1", "2")

    @property
    def thermal_growth_per_c(self) -> float:
        """By how much its distance grows."""
        return self.expansion_per_c

    def size_problem(self, ball_mm: float) -> str | None:
        """The ball must have room inside."""
        if self.side == "inside" and self.distance_mm <= 2.0 * ball_mm:
            return (
                f"distance_mm = {self.distance_mm:g} is touched from inside by a ball "
                f"of {ball_mm:g} mm radius; make it larger than {2.0 * ball_mm:g}"
            )
        return None

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """Spread evenly over both faces; their normal is the third axis."""
        side = 1.0 if self.side == "outside" else INWARDS
        ends = np.where(features == 0, -1.0, 1.0)
        half_mm = 0.5 * self.size_mm
        centres_mm = np.empty((len(features), 3))
        centres_mm[:, :2] = rng.uniform(-half_mm, half_mm, (len(features), 2))
        centres_mm[:, 2] = ends * (0.5 * self.distance_mm * growths + side * ball_mm)
        towards = np.zeros((len(features), 3))
        towards[:, 2] = -side * ends
        return Contacts(centres_mm, towards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Its distance, as the certificate has it."""
        return {
            **stated_length(rng, "distance", self.distance_mm, self.distance_std_mm),
            **({} if self.side == "outside" else {"side": self.side}),
            **stated_expansion(self.expansion_per_c),
        }

    def true_table(self, placement: Placement) -> Table:
        """Normal from face 1 to face 2, its products with points of each, distance."""
        normal = placement.rotation[:, 2]
        middle_mm = float(normal @ placement.position_mm)
        half_mm = 0.5 * self.distance_mm
        return {
            "normal": normal.tolist(),
            "offsets_mm": [middle_mm - half_mm, middle_mm + half_mm],
            "distance_mm": self.distance_mm,
        }
