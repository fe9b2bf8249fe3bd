"""Rest: the arm stays where it is."""

from pydantic import Field

from traverse.simulator.motions.motion import Motion
from traverse.simulator.motions.stage import CourseBuilder


class RestMotion(Motion):
    """Hold still for a time."""

    duration_s: float = Field(gt=0.0)

    def play(self, stage: CourseBuilder) -> None:
        """Append this motion to the course."""
        stage.rest(self.duration_s)
