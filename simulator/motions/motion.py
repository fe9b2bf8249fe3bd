"""Base class of motions of a configuration, and those that touch nothing."""

from typing import Annotated, ClassVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializeAsAny,
)

from traverse.simulator.kind_table import KindTable
from traverse.simulator.motions.stage import CourseBuilder
from traverse.simulator.scenario.recorded_counts import read_recording
from traverse.simulator.scenario.script import ScriptEvent

Vector = tuple[float, float, float]


def _pointing(direction: Vector) -> Vector:
    if not any(direction):
        raise ValueError("[0, 0, 0] points nowhere; give a direction of any length")
    return direction


Direction = Annotated[Vector, AfterValidator(_pointing)]


class Motion(KindTable):
    """A motion; every kind is a class of its own."""

    FAMILY = "motion"
    KINDS: ClassVar[dict[str, type["Motion"]]] = {}  # filled by the package

    def play(self, stage: CourseBuilder) -> None:
        raise NotImplementedError(self.kind)


AnyMotion = Annotated[SerializeAsAny[Motion], BeforeValidator(Motion.from_table)]


class RestMotion(Motion):
    """Hold still for a time."""

    duration_s: float = Field(gt=0.0)

    def play(self, stage: CourseBuilder) -> None:
        stage.rest(self.duration_s)


class ReplayMotion(Motion):
    """Play the counts of a CSV file; the inputs change as in its columns."""

    file: str

    def play(self, stage: CourseBuilder) -> None:
        recording = read_recording(stage.folder / self.file)
        stage.events += [
            ScriptEvent(time_s, name, level)
            for time_s, name, level in recording.input_changes()
        ]
        stage.rest(recording.duration_s)
