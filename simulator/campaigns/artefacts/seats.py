"""Artefacts that hold the ball: cones, alone and on bars, known points, a draw wire."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.simulator.campaigns.artefacts.artefact import (
    Artefact,
    Contacts,
    Placement,
    Standard,
    Table,
    Touches,
    drawn_directions,
    no_directions,
    stated_length,
)


class Seated(Artefact):
    """Seats for the ball, which expand about their origin."""

    IS_FIXED: ClassVar[bool] = True

    @property
    def seats_mm(self) -> Floats:
        return np.zeros((1, 3))

    def contacts(self, touches: Touches) -> Contacts:
        centres_mm = self.seats_mm[touches.features] * touches.growths[:, None]
        return Contacts(centres_mm, no_directions(touches.n))

    def true_table(self, placement: Placement) -> Table:
        true_mm = placement.points_mm(self.seats_mm)
        return {"points_mm": dict(zip(self.features, true_mm.tolist(), strict=True))}


class Cone(Seated):
    """A seat for the ball."""

    kind: Literal["cone"] = "cone"

    def true_table(self, placement: Placement) -> Table:
        return {"point_mm": placement.position_mm.tolist()}


class Seats(Seated, Standard):
    """A bar of cones in a row, which expand about its middle.

    The standard deviation is of the stated distances.
    """

    kind: Literal["seats"] = "seats"
    n_seats: int = Field(default=2, ge=2)
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float = Field(default=0.0, ge=0.0)

    @property
    def features(self) -> tuple[str, ...]:
        return tuple(str(number + 1) for number in range(self.n_seats))

    @property
    def seats_mm(self) -> Floats:
        """Seats (n_seats, 3) along the third axis, about their middle."""
        places_mm = np.zeros((self.n_seats, 3))
        steps = np.arange(self.n_seats) - 0.5 * (self.n_seats - 1)
        places_mm[:, 2] = self.distance_mm * steps
        return places_mm

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Return distances from the first seat by the certificate."""
        std_mm = self.distance_std_mm
        stated = [
            stated_length(rng, "distance", number * self.distance_mm, std_mm)
            for number in range(1, self.n_seats)
        ]
        if self.n_seats == 2:
            return {**stated[0], **self.stated_expansion}
        named = [
            {"between": ["1", name], **table}
            for name, table in zip(self.features[1:], stated, strict=True)
        ]
        return {**self.stated_expansion, "distances": named}


PLASTIC = 1.2207440846057596  # root of x^4 = x + 1: its powers spread points evenly


class Points(Seated, Standard):
    """Seats spread over a cube; they expand about its middle.

    Attributes:
        size_mm: side of the cube.
        frame: system of their coordinates.
        scale: length in the arm's system over length in their own.
        points_std_mm: of each coordinate that the campaign states.
        orientations: the instrument measures the orientation of its probe, too.
    """

    kind: Literal["points"] = "points"
    n_points: int = Field(default=8, ge=1)
    size_mm: float = Field(gt=0.0)
    frame: Literal["arm", "own", "own_scaled"] = "own"
    scale: float = Field(default=1.0, gt=0.0)
    points_std_mm: float = Field(default=0.0, ge=0.0)
    orientations: bool = False

    @property
    def features(self) -> tuple[str, ...]:
        return tuple(f"P{number + 1}" for number in range(self.n_points))

    @property
    def own_mm(self) -> Floats:
        """Coordinates (n_points, 3) in their own system."""
        steps = PLASTIC ** -np.arange(1.0, 4.0)
        shares = (0.5 + np.arange(1, self.n_points + 1)[:, None] * steps) % 1.0
        spread: Floats = self.size_mm / self.scale * (shares - 0.5)
        return spread

    @property
    def seats_mm(self) -> Floats:
        """Points in the arm's system but for their place."""
        return self.scale * self.own_mm

    def size_problem(self, ball_mm: float) -> str | None:
        if self.expansion_per_c and self.frame == "arm":
            return (
                f"expansion_per_c = {self.expansion_per_c:g} with frame = 'arm'; "
                "points of the arm's own system stay where they are; remove it"
            )
        if self.scale != 1.0 and self.frame != "own_scaled":
            return (
                f"scale = {self.scale:g} with frame = '{self.frame}'; only "
                "'own_scaled' has a scale"
            )
        return None

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        known_mm = self.own_mm
        if self.frame == "arm":
            known_mm = placement.points_mm(known_mm)
        known_mm = known_mm + self.points_std_mm * rng.standard_normal(known_mm.shape)
        table: Table = {"frame": self.frame}
        if self.points_std_mm > 0.0:
            table["points_std_mm"] = self.points_std_mm
        table |= self.stated_expansion
        table["points_mm"] = dict(zip(self.features, known_mm.tolist(), strict=True))
        return table

    def true_table(self, placement: Placement) -> Table:
        """The parameters of x = t + s R x_own; the points in the arm's system."""
        return {
            "rotation": placement.rotation.tolist(),
            "translation_mm": placement.position_mm.tolist(),
            "scale": self.scale,
            **super().true_table(placement),
        }


class DrawWire(Artefact):
    """A wire whose end is held at the ball's centre.

    Attributes:
        shortest_mm: least distance of the ball from the anchor.
        offset_mm: actual distance minus reading.
        known: whether the campaign states the offset.
        opening_rad: from the wire's middle direction to the last.
    """

    kind: Literal["draw_wire"] = "draw_wire"
    shortest_mm: float = Field(gt=0.0)
    longest_mm: float = Field(gt=0.0)
    offset_mm: float = 0.0
    known: bool = False
    opening_rad: float = Field(default=1.2, gt=0.0, le=float(np.pi))

    def size_problem(self, ball_mm: float) -> str | None:
        if self.longest_mm <= self.shortest_mm:
            return (
                f"longest_mm = {self.longest_mm:g} is not longer than shortest_mm = "
                f"{self.shortest_mm:g}"
            )
        return None

    def contacts(self, touches: Touches) -> Contacts:
        """Draw places in a cap of a shell around the anchor."""
        outwards = drawn_directions(touches.rng, touches.n, self.opening_rad)
        drawn_mm = touches.rng.uniform(self.shortest_mm, self.longest_mm, touches.n)
        return Contacts(drawn_mm[:, None] * outwards, no_directions(touches.n))

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        return {"offset_mm": self.offset_mm} if self.known else {}

    def true_table(self, placement: Placement) -> Table:
        return {
            "anchor_mm": placement.position_mm.tolist(),
            "offset_mm": self.offset_mm,
        }
