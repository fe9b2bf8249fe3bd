"""Sweep: the ball is led over a surface on a spiral, the button held down."""

from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.spread import crossed, unit
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.motions.touching import Contact, hard_approach, solve_contacts

KNOT_DISTANCE_MM = 1.0
FEWEST_KNOTS, MOST_KNOTS = 64, 4096


class Sweep(Motion):
    """Scan a sphere or a plane.

    The spiral begins at the pole of the sphere or at the centre of the plane;
    `radius_mm` is the sphere's, or how far the spiral on the plane reaches.
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
        """Append this motion to the course."""
        fine, _ = self._spiral(np.linspace(0.0, 1.0, 2000))
        length_mm = float(np.sum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
        n_knots = int(np.clip(length_mm / KNOT_DISTANCE_MM, FEWEST_KNOTS, MOST_KNOTS))
        u = np.linspace(0.0, 1.0, n_knots)
        surfaces_mm, normals = self._spiral(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
        centres_mm = surfaces_mm + stage.radius_mm * normals
        contact = Contact(self.artefact, "", surfaces_mm[0], normals[0])
        posture = solve_contacts(stage, [contact])
        swept = stage.reach.along(posture, centres_mm[:, None])[:, 0]
        approach = hard_approach(stage)
        away_mm = approach.distances_mm[::-1, None]
        come = _along(stage, swept[0], centres_mm[0] + away_mm * normals[0])[::-1]
        leave = _along(stage, swept[-1], centres_mm[-1] + away_mm * normals[-1])
        stage.move(come[0], stage.operator.move_s)
        stage.follow(come, approach.times_s)
        stage.events.append(contact.change(stage.time_s, "button", 1))
        stage.follow(swept, length_mm / self.speed_mm_s * u)
        last = Contact(self.artefact, "", surfaces_mm[-1], normals[-1])
        stage.events.append(last.change(stage.time_s, "button", 0))
        stage.follow(leave, approach.times_s)

    def _spiral(self, fractions: Floats) -> tuple[Floats, Floats]:
        """Surface points and normals (n, 3) at fractions (n,) of the spiral."""
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


def _along(stage: CourseBuilder, posture_rad: Floats, targets_mm: Floats) -> Floats:
    return stage.reach.along(posture_rad[None, :], targets_mm[:, None])[:, 0]
