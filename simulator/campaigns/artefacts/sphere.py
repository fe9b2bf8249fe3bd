"""Sphere: of known or unknown radius, touched from outside or inside."""

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
from traverse.simulator.campaigns.artefacts.placement import Placement, drawn_directions

INWARDS = -1.0


class Sphere(Artefact):
    """A sphere on a stem.

    Attributes:
        radius_mm: True radius.
        known: The campaign states the radius.
        radius_std_mm: Of the stated radius.
        side: Where the ball is.
        opening_rad: From the pole, which is opposite the stem, to the last contact.
        expansion_per_c: Of the radius.
    """

    kind: Literal["sphere"] = "sphere"
    radius_mm: float = Field(gt=0.0)
    known: bool = False
    radius_std_mm: float = Field(default=0.0, ge=0.0)
    side: Literal["outside", "inside"] = "outside"
    opening_rad: float = Field(default=2.2, gt=0.0, le=float(np.pi))
    expansion_per_c: float = 0.0

    @property
    def thermal_growth_per_c(self) -> float:
        """By how much its radius grows."""
        return self.expansion_per_c

    def size_problem(self, ball_mm: float) -> str | None:
        """The ball must have room inside."""
        if self.side == "inside" and self.radius_mm <= ball_mm:
            return (
                f"radius_mm = {self.radius_mm:g} is touched from inside by a ball of "
                f"{ball_mm:g} mm radius; make it larger"
            )
        return None

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """Spread evenly over a cap."""
        outwards = drawn_directions(rng, len(features), self.opening_rad)
        side = 1.0 if self.side == "outside" else INWARDS
        distances_mm = self.radius_mm * growths + side * ball_mm
        return Contacts(distances_mm[:, None] * outwards, -side * outwards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Its radius if that is known."""
        radius = stated_length(rng, "radius", self.radius_mm, self.radius_std_mm)
        return {
            **(radius if self.known else {}),
            **({} if self.side == "outside" else {"side": self.side}),
            **stated_expansion(self.expansion_per_c),
        }

    def true_table(self, placement: Placement) -> Table:
        """Centre and radius."""
        return {
            "centre_mm": placement.position_mm.tolist(),
            "radius_mm": self.radius_mm,
        }
