"""The kinds of artefacts: one file and one entry here each."""

from collections.abc import Mapping

from pydantic import ConfigDict, field_validator

from traverse.kinematics.arm_file import StrictModel
from traverse.kinematics.file_problems import unknown_name_message
from traverse.kinematics.model_problems import tuples_for_lists
from traverse.lab.identification.artefacts.artefact import Artefact
from traverse.lab.identification.artefacts.ball_bar import BallBar
from traverse.lab.identification.artefacts.cone import Cone
from traverse.lab.identification.artefacts.parallel_planes import ParallelPlanes
from traverse.lab.identification.artefacts.plane import Plane
from traverse.lab.identification.artefacts.points import Points
from traverse.lab.identification.artefacts.sphere import Sphere

__all__ = ["ARTEFACT_KINDS", "Artefact", "ArtefactTable", "artefact_from_table"]

ARTEFACT_KINDS: Mapping[str, type[Artefact]] = {
    "cone": Cone,
    "ball_bar": BallBar,
    "sphere": Sphere,
    "plane": Plane,
    "parallel_planes": ParallelPlanes,
    "points": Points,
}


class ArtefactTable(StrictModel):
    """A table of any kind; by itself one of no known kind, refused for that alone."""

    model_config = ConfigDict(extra="ignore")

    kind: str

    @classmethod
    def variant(cls, table: object) -> type[StrictModel]:
        """Say the class of a table by its kind."""
        return artefact_class(table)

    @field_validator("kind")
    @classmethod
    def _unknown(cls, kind: str) -> str:
        raise ValueError(unknown_name_message("kind", kind, ARTEFACT_KINDS))


def artefact_class(table: object) -> type[StrictModel]:
    """Say the class of a table by its kind."""
    kind = table.get("kind") if isinstance(table, Mapping) else None
    return ARTEFACT_KINDS.get(str(kind), ArtefactTable)


def artefact_from_table(table: object) -> object:
    """Make an artefact of the class that its kind asks for."""
    if isinstance(table, Artefact):
        return table
    return artefact_class(table).model_validate(tuples_for_lists(table))
