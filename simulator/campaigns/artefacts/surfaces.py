"""Artefacts with surfaces: a plane, a gauge block or gap, a sphere, a ball bar."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.simulator.campaigns.artefacts.artefact import (
    Artefact,
    Contacts,
    Placement,
    Standard,
    Table,
    Touches,
    drawn_directions,
    stated_length,
)


class Plane(Artefact):
    """A square plate."""

    kind: Literal["plane"] = "plane"
    size_mm: float = Field(gt=0.0)

    def contacts(self, touches: Touches) -> Contacts:
        """Draw contacts evenly; the plate's outer normal is the third axis."""
        centres_mm = np.full((touches.n, 3), touches.ball_mm)
        half_mm = 0.5 * self.size_mm
        centres_mm[:, :2] = touches.rng.uniform(-half_mm, half_mm, (touches.n, 2))
        return Contacts(centres_mm, np.tile([0.0, 0.0, -1.0], (touches.n, 1)))

    def true_table(self, placement: Placement) -> Table:
        """Return the outer normal, and its product with any point of the plane."""
        normal = placement.rotation[:, 2]
        return {
            "normal": normal.tolist(),
            "offset_mm": float(normal @ placement.position_mm),
        }


INWARDS = -1.0


class ParallelPlanes(Standard):
    """Two square faces, features 1 and 2; the stated distance has the deviation."""

    kind: Literal["parallel_planes"] = "parallel_planes"
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float = Field(default=0.0, ge=0.0)
    size_mm: float = Field(gt=0.0)
    side: Literal["outside", "inside"] = "outside"

    @property
    def features(self) -> tuple[str, ...]:
        return ("1", "2")

    def size_problem(self, ball_mm: float) -> str | None:
        """State why the ball has no room inside."""
        if self.side == "inside" and self.distance_mm <= 2.0 * ball_mm:
            return (
                f"distance_mm = {self.distance_mm:g} is touched from inside by a ball "
                f"of {ball_mm:g} mm radius; make it larger than {2.0 * ball_mm:g}"
            )
        return None

    def contacts(self, touches: Touches) -> Contacts:
        """Draw contacts evenly over both faces; their normal is the third axis."""
        side = 1.0 if self.side == "outside" else INWARDS
        ends = np.where(touches.features == 0, -1.0, 1.0)
        half_mm = 0.5 * self.size_mm
        centres_mm = np.empty((touches.n, 3))
        centres_mm[:, :2] = touches.rng.uniform(-half_mm, half_mm, (touches.n, 2))
        centres_mm[:, 2] = ends * (
            0.5 * self.distance_mm * touches.growths + side * touches.ball_mm
        )
        towards = np.zeros((touches.n, 3))
        towards[:, 2] = -side * ends
        return Contacts(centres_mm, towards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        return {
            **stated_length(rng, "distance", self.distance_mm, self.distance_std_mm),
            **({} if self.side == "outside" else {"side": self.side}),
            **self.stated_expansion,
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


class Sphere(Standard):
    """A sphere on a stem.

    Attributes:
        radius_mm: true radius.
        known: whether the campaign states the radius.
        radius_std_mm: of the stated radius.
        side: where the ball is.
        opening_rad: from the pole, opposite the stem, to the last contact.
    """

    kind: Literal["sphere"] = "sphere"
    radius_mm: float = Field(gt=0.0)
    known: bool = False
    radius_std_mm: float = Field(default=0.0, ge=0.0)
    side: Literal["outside", "inside"] = "outside"
    opening_rad: float = Field(default=2.2, gt=0.0, le=float(np.pi))

    def size_problem(self, ball_mm: float) -> str | None:
        if self.side == "inside" and self.radius_mm <= ball_mm:
            return (
                f"radius_mm = {self.radius_mm:g} is touched from inside by a ball of "
                f"{ball_mm:g} mm radius; make it larger"
            )
        return None

    def contacts(self, touches: Touches) -> Contacts:
        """Draw contacts evenly over a cap."""
        outwards = drawn_directions(touches.rng, touches.n, self.opening_rad)
        side = 1.0 if self.side == "outside" else INWARDS
        distances_mm = self.radius_mm * touches.growths + side * touches.ball_mm
        return Contacts(distances_mm[:, None] * outwards, -side * outwards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        radius = stated_length(rng, "radius", self.radius_mm, self.radius_std_mm)
        return {
            **(radius if self.known else {}),
            **({} if self.side == "outside" else {"side": self.side}),
            **self.stated_expansion,
        }

    def true_table(self, placement: Placement) -> Table:
        return {
            "centre_mm": placement.position_mm.tolist(),
            "radius_mm": self.radius_mm,
        }


BAR_RAD = 0.6  # around the bar the spheres cannot be touched


class BallBar(Standard):
    """Two spheres, features 1 and 2, of one radius unless the second has its own."""

    kind: Literal["ball_bar"] = "ball_bar"
    radius_mm: float = Field(gt=0.0)
    second_radius_mm: float | None = Field(default=None, gt=0.0)
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float = Field(default=0.0, ge=0.0)
    radius_std_mm: float = Field(default=0.0, ge=0.0)

    @property
    def features(self) -> tuple[str, ...]:
        return ("1", "2")

    @property
    def radii_mm(self) -> tuple[float, float]:
        second = self.second_radius_mm
        return (self.radius_mm, self.radius_mm if second is None else second)

    def size_problem(self, ball_mm: float) -> str | None:
        needed_mm = sum(self.radii_mm) + 2.0 * ball_mm
        if self.distance_mm <= needed_mm:
            return (
                f"distance_mm = {self.distance_mm:g} leaves no room for a ball of "
                f"{ball_mm:g} mm radius; make it longer than {needed_mm:g}"
            )
        return None

    def contacts(self, touches: Touches) -> Contacts:
        """Draw contacts around both spheres except near the bar, the third axis."""
        outwards = drawn_directions(touches.rng, touches.n, np.pi - BAR_RAD)
        ends = np.where(touches.features == 0, -1.0, 1.0)
        outwards[:, 2] *= ends
        distances_mm = (
            np.array(self.radii_mm)[touches.features] * touches.growths
            + touches.ball_mm
        )
        centres_mm = distances_mm[:, None] * outwards
        centres_mm[:, 2] += 0.5 * self.distance_mm * ends * touches.growths
        return Contacts(centres_mm, -outwards)

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
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
        return {**radius, **distance, **self.stated_expansion}

    def true_table(self, placement: Placement) -> Table:
        own_mm = np.zeros((2, 3))
        own_mm[:, 2] = -0.5 * self.distance_mm, 0.5 * self.distance_mm
        return {
            "centres_mm": placement.points_mm(own_mm).tolist(),
            "radii_mm": list(self.radii_mm),
            "distance_mm": self.distance_mm,
        }
