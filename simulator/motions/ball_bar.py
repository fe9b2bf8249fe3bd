"""Ball bar: two spheres a known distance apart are touched."""

import numpy as np
from pydantic import Field

from traverse.simulator.motions.motion import Direction, Motion, Vector
from traverse.simulator.motions.sphere import sphere_contacts
from traverse.simulator.motions.spread import unit
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.motions.touching import touch


class BallBar(Motion):
    """Touch sphere 1, then sphere 2, at the ends of a bar."""

    artefact: str = "bar"
    centre_mm: Vector
    direction: Direction
    distance_mm: float = Field(default=800.0, gt=0.0)
    radius_mm: float = Field(default=25.4, gt=0.0)
    points: int = Field(ge=1)
    pole: Direction = (0.0, 0.0, 1.0)
    opening_rad: float = Field(default=1.4, gt=0.0, le=3.0)

    def play(self, stage: CourseBuilder) -> None:
        """Append this motion to the course."""
        half_mm = 0.5 * self.distance_mm * unit(self.direction)
        for feature, side in (("1", -1.0), ("2", 1.0)):
            centre_mm = np.array(self.centre_mm) + side * half_mm
            contacts, is_clear = sphere_contacts(
                (self.artefact, feature),
                centre_mm,
                self.radius_mm,
                (unit(self.pole), self.opening_rad, self.points),
            )
            touch(stage, contacts, is_clear)
