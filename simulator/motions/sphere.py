"""Sphere: points spread over a cap of a sphere are touched from outside."""

from collections.abc import Callable

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans, Floats
from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.spread import cap_directions, unit
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.motions.touching import Contact, touch


class Sphere(Motion):
    """Touch a sphere."""

    artefact: str = "sphere"
    centre_mm: Vector
    radius_mm: float = Field(gt=0.0)
    points: int = Field(ge=1)
    pole: Direction = (0.0, 0.0, 1.0)
    opening_rad: float = Field(default=1.4, gt=0.0, le=3.0)

    def play(self, stage: CourseBuilder) -> None:
        """Append this motion to the course."""
        contacts, is_clear = sphere_contacts(
            (self.artefact, ""),
            np.array(self.centre_mm),
            self.radius_mm,
            (unit(self.pole), self.opening_rad, self.points),
        )
        touch(stage, contacts, is_clear)


def sphere_contacts(
    names: tuple[str, str],
    centre_mm: Floats,
    radius_mm: float,
    cap: tuple[Floats, float, int],
) -> tuple[list[Contact], Callable[[Floats, float], Booleans]]:
    """Contacts over a cap of a sphere.

    Args:
        names: Artefact and feature.
        centre_mm: (3,)
        radius_mm: Of the sphere.
        cap: Pole (3,), opening angle, number of points.

    Returns:
        The contacts, and whether balls at places (n, 3) of some radius are outside.
    """

    def is_clear(places_mm: Floats, ball_mm: float) -> Booleans:
        distances_mm: Floats = np.linalg.norm(places_mm - centre_mm, axis=1)
        return distances_mm > radius_mm + ball_mm

    contacts = [
        Contact(*names, centre_mm + radius_mm * normal, normal)
        for normal in cap_directions(*cap)
    ]
    return contacts, is_clear
