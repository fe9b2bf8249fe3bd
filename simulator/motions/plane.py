"""Plane: a grid of points on a flat surface is touched."""

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans, Floats
from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.spread import crossed, unit
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.motions.touching import Contact, touch


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
        """Append this motion to the course."""
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
