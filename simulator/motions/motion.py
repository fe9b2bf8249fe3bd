"""What all motions of a configuration have in common."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    SerializeAsAny,
    field_validator,
)

from traverse.simulator.motions.stage import CourseBuilder
from traverse.strict_toml.reader import StrictModel

Vector = tuple[float, float, float]


def _pointing(direction: Vector) -> Vector:
    if not any(direction):
        raise ValueError("[0, 0, 0] points nowhere; give a direction of any length")
    return direction


Direction = Annotated[Vector, AfterValidator(_pointing)]
KINDS: dict[
    str, type["Motion"]
] = {}  # filled by traverse.simulator.motions, the only table


class Motion(StrictModel):
    """A motion; every kind is a class of its own in a file of its own."""

    kind: str

    @classmethod
    def variant(cls, table: object) -> "type[Motion]":
        """Select the class of a table by its kind."""
        kind = table.get("kind") if isinstance(table, Mapping) else None
        return KINDS.get(str(kind), UnknownMotion)

    def play(self, stage: CourseBuilder) -> None:
        """Append this motion to the course."""
        raise NotImplementedError(self.kind)


class UnknownMotion(Motion):
    """What is of no known kind: refused for that alone, not for its other keys."""

    model_config = ConfigDict(extra="ignore")

    @field_validator("kind")
    @classmethod
    def _refuse(cls, kind: str) -> str:
        known = ", ".join(sorted(KINDS))
        raise ValueError(f"unknown kind of motion '{kind}'; known: {known}")


def motion_from_table(table: object) -> Motion:
    """Make a motion of the class of its kind."""
    if isinstance(table, Motion):
        return table
    return Motion.variant(table).model_validate(table)


AnyMotion = Annotated[SerializeAsAny[Motion], BeforeValidator(motion_from_table)]
