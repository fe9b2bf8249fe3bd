"""Surfaces are touched or swept over: spheres, a ball bar, planes."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans, Floats
from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.motions.touching import (
    Contact,
    hard_approach,
    solve_contacts,
    touch,
)


def crossed(normal: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors that span the plane across a unit vector (3,)."""
    least_aligned = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = least_aligned - (least_aligned @ normal) * normal
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def unit(vector: tuple[float, float, float]) -> Floats:
    components = np.array(vector, dtype=np.float64)
    direction: Floats = components / np.linalg.norm(components)
    return direction


def cap_directions(pole: Floats, opening_rad: float, n_points: int) -> Floats:
    """Return unit vectors (n, 3) within an angle of the pole, on a golden spiral."""
    heights = np.linspace(1.0, np.cos(opening_rad), n_points)
    around = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n_points)
    radii = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    first, second = crossed(pole)
    directions: Floats = (
        (radii * np.cos(around))[:, None] * first
        + (radii * np.sin(around))[:, None] * second
        + heights[:, None] * pole
    )
    return directions


class _Balls(Motion):
    """Touch spheres of one radius, each over a cap around the pole."""

    artefact: str
    centre_mm: Vector
    radius_mm: float = Field(gt=0.0)
    points: int = Field(ge=1)
    pole: Direction = (0.0, 0.0, 1.0)
    opening_rad: float = Field(default=1.4, gt=0.0, le=3.0)

    def touch_ball(self, stage: CourseBuilder, feature: str, centre_mm: Floats) -> None:
        def is_clear(places_mm: Floats, ball_mm: float) -> Booleans:
            distances_mm: Floats = np.linalg.norm(places_mm - centre_mm, axis=1)
            return distances_mm > self.radius_mm + ball_mm

        cap = cap_directions(unit(self.pole), self.opening_rad, self.points)
        contacts = [
            Contact(self.artefact, feature, centre_mm + self.radius_mm * normal, normal)
            for normal in cap
        ]
        touch(stage, contacts, is_clear)


class Sphere(_Balls):
    """Touch a sphere."""

    artefact: str = "sphere"

    def play(self, stage: CourseBuilder) -> None:
        self.touch_ball(stage, "", np.array(self.centre_mm))


class BallBar(_Balls):
    """Touch sphere 1, then sphere 2, at the ends of a bar."""

    artefact: str = "bar"
    direction: Direction
    distance_mm: float = Field(default=800.0, gt=0.0)
    radius_mm: float = Field(default=25.4, gt=0.0)

    def play(self, stage: CourseBuilder) -> None:
        half_mm = 0.5 * self.distance_mm * unit(self.direction)
        for feature, side in (("1", -1.0), ("2", 1.0)):
            self.touch_ball(stage, feature, np.array(self.centre_mm) + side * half_mm)


class Plane(Motion):
    """Touch a plane."""

    artefact: str = "plane"
    feature: str = ""
    centre_mm: Vector
    normal: Direction = (0.0, 0.0, 1.0)
    width_mm: float = Field(default=200.0, gt=0.0)
    depth_mm: float = Field(default=200.0, gt=0.0)
    columns: int = Field(default=4, ge=1)
    rows: int = Field(default=4, ge=1)

    def play(self, stage: CourseBuilder) -> None:
        normal, centre_mm = unit(self.normal), np.array(self.centre_mm)
        across, along = crossed(normal)
        contacts = []
        for row, v in enumerate(_spread(self.rows, self.depth_mm)):
            places = _spread(self.columns, self.width_mm)
            for u in places if row % 2 == 0 else places[::-1]:
                surface_mm = centre_mm + u * across + v * along
                contacts.append(
                    Contact(self.artefact, self.feature, surface_mm, normal)
                )

        def is_clear(places_mm: Floats, ball_mm: float) -> Booleans:
            heights: Floats = (places_mm - centre_mm) @ normal
            return heights > ball_mm

        touch(stage, contacts, is_clear)


def _spread(number: int, size_mm: float) -> Floats:
    if number == 1:
        return np.zeros(1)
    return np.linspace(-0.5 * size_mm, 0.5 * size_mm, number)


KNOT_DISTANCE_MM = 1.0
FEWEST_KNOTS, MOST_KNOTS = 64, 4096


class Sweep(Motion):
    """Scan a sphere or a plane.

    The spiral begins at the pole of the sphere or at the centre of the plane;
    `radius_mm` is of the sphere, or of the spiral on the plane.
    """

    over: Literal["sphere", "plane"]
    artefact: str = "sweep"
    centre_mm: Vector
    radius_mm: float = Field(gt=0.0)
    normal: Direction = (0.0, 0.0, 1.0)
    opening_rad: float = Field(default=1.0, gt=0.0, le=2.0)
    windings: float = Field(default=3.0, gt=0.0, le=50.0)
    speed_mm_s: float = Field(default=20.0, gt=0.0)

    def play(self, stage: CourseBuilder) -> None:
        fine, _ = self._spiral(np.linspace(0.0, 1.0, 2000))
        length_mm = float(np.sum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
        n_knots = int(np.clip(length_mm / KNOT_DISTANCE_MM, FEWEST_KNOTS, MOST_KNOTS))
        u = np.linspace(0.0, 1.0, n_knots)
        surfaces_mm, normals = self._spiral(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
        centres_mm = surfaces_mm + stage.radius_mm * normals
        contact = Contact(self.artefact, "", surfaces_mm[0], normals[0])
        posture = solve_contacts(stage, [contact])
        swept = stage.reach.path(posture[0], centres_mm)
        approach = hard_approach(stage)
        away_mm = approach.distances_mm[::-1, None]
        approach_path = stage.reach.path(
            swept[0], centres_mm[0] + away_mm * normals[0]
        )[::-1]
        leave = stage.reach.path(swept[-1], centres_mm[-1] + away_mm * normals[-1])
        stage.move(approach_path[0], stage.operator.move_s)
        stage.follow(approach_path, approach.times_s)
        stage.events.append(contact.change(stage.time_s, "button", 1))
        stage.follow(swept, length_mm / self.speed_mm_s * u)
        last = Contact(self.artefact, "", surfaces_mm[-1], normals[-1])
        stage.events.append(last.change(stage.time_s, "button", 0))
        stage.follow(leave, approach.times_s)

    def _spiral(self, fractions: Floats) -> tuple[Floats, Floats]:
        """Return surface points and normals (n, 3) at fractions (n,) of the spiral."""
        pole, centre_mm = unit(self.normal), np.array(self.centre_mm)
        first, second = crossed(pole)
        around = 2.0 * np.pi * self.windings * fractions
        outward = np.cos(around)[:, None] * first + np.sin(around)[:, None] * second
        if self.over == "plane":
            radii_mm = (self.radius_mm * fractions)[:, None]
            return centre_mm + radii_mm * outward, np.tile(pole, (len(fractions), 1))
        polar = (self.opening_rad * fractions)[:, None]
        normals = np.cos(polar) * pole + np.sin(polar) * outward
        return centre_mm + self.radius_mm * normals, normals
