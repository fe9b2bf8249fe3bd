"""Sphere: points spread over a cap of a sphere are touched from outside."""

from pydantic import Field

from simulator.motions.motion import Motion, Vector
from simulator.motions.spread import cap_directions, unit
from simulator.motions.stage import Stage
from simulator.motions.touching import Contact, touch


class Sphere(Motion):
    """Touch a sphere."""

    artefact: str = "sphere"
    centre_mm: Vector
    radius_mm: float = Field(gt=0.0)
    points: int = Field(ge=1)
    pole: Vector = (0.0, 0.0, 1.0)
    opening_rad: float = Field(default=1.4, gt=0.0, le=3.0)

    def play(self, stage: Stage) -> None:
        """Append this motion to the course."""
        centre_mm = self.centre_mm
        directions = cap_directions(unit(self.pole), self.opening_rad, self.points)
        contacts = [
            Contact(self.artefact, "", centre_mm + self.radius_mm * normal, normal)
            for normal in directions
        ]
        touch(stage, contacts)
