"""Ball bar: two spheres at a known distance, held at its middle."""

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

BAR_RAD = 0.6  # around the bar the spheres cannot be touched


class BallBar(Artefact):
    """Two spheres, features 1 and 2.

    Attributes:
        radius_mm: Of the first sphere, and of the second where that has none.
        second_radius_mm: Of the second sphere.
        distance_mm: True distance of the centres.
        distance_std_mm: Of the distance that the campaign states.
        radius_std_mm: Of the radii that it states.
        expansion_per_c: Of all its lengths.
    """

    kind: Literal["ball_bar"] = "ball_bar"
    radius_mm: float = Field(gt=0.0)
    second_radius_mm: float | None = Field(default=None, gt=0.0)
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float = Field(default=0.0, ge=0.0)
    radius_std_mm: float = Field(default=0.0, ge=0.0)
    expansion_per_c: float = 0.0

    @property
    def features(self) -> tuple[str, ...]:
        """The two spheres."""
        return ("1", "2")

    @property
    def thermal_growth_per_c(self) -> float:
        """By how much its lengths grow."""
        return self.expansion_per_c

    @property
    def radii_mm(self) -> tuple[float, float]:
        """Of both spheres."""
        second = self.second_radius_mm
        return (self.radius_mm, self.radius_mm if second is None else second)

    def size_problem(self, ball_mm: float) -> str | None:
        """The spheres must be apart."""
        needed_mm = sum(self.radii_mm) + 2.0 * ball_mm
        if self.distance_mm <= needed_mm:
            return (
                f"distance_mm = {self.distance_mm:g} leaves no room for a ball of "
                f"{ball_mm:g} mm radius; make it longer than {needed_mm:g}"
            )
        return None

    def contacts(
        self,
        rng: np.random.Generator,
        features: Indices,
        ball_mm: float,
        growths: Floats,
    ) -> Contacts:
        """All around both spheres but where the bar is, along the third axis."""
        outwards = drawn_directions(rng, len(features), np.pi - BAR_RAD)
        ends = np.where(features == 0, -1.0, 1.0)
        outwards[:, 2] *= ends
        distances_mm = np.array(self.radii_mm)[features] * growths + ball_mm
        centres_mm = distances_mm[:, None] * outwards
        centres_mm[:, 2] += 0.5 * self.distance_mm * ends * growths
        return Contacts(centres_mm, -outwards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Its distance and radii, as the certificate has them."""
        distance = stated_length(
            rng, "distance", self.distance_mm, self.distance_std_mm
        )
        radii_mm = np.array(self.radii_mm)
        radii_mm += self.radius_std_mm * rng.standard_normal(2)
        radius: Table = {"radius_mm": radii_mm.tolist()}
        if radii_mm[0] == radii_mm[1]:
            radius = {"radius_mm": float(radii_mm[0])}
        if self.radius_std_mm > 0.0:
            radius["radius_std_mm"] = self.radius_std_mm
        return {**radius, **distance, **stated_expansion(self.expansion_per_c)}

    def true_table(self, placement: Placement) -> Table:
        """Centres of the spheres, radii and distance."""
        own_mm = np.zeros((2, 3))
        own_mm[:, 2] = -0.5 * self.distance_mm, 0.5 * self.distance_mm
        return {
            "centres_mm": placement.points_mm(own_mm).tolist(),
            "radii_mm": list(self.radii_mm),
            "distance_mm": self.distance_mm,
        }
