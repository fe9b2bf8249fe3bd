"""The kinds of artefacts: one file and one entry here each."""

from collections.abc import Mapping

from pydantic import ConfigDict, field_validator

from traverse.lab.artefacts.artefact import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.cone import Cone
from traverse.lab.artefacts.draw_wire import DrawWire
from traverse.lab.artefacts.parallel_planes import ParallelPlanes
from traverse.lab.artefacts.plane import Plane
from traverse.lab.artefacts.points import Points
from traverse.lab.artefacts.seats import Seats
from traverse.lab.artefacts.sphere import Sphere
from traverse.strict_toml.problems import unknown_name_message
from traverse.strict_toml.reader import StrictModel, tuples_for_lists

__all__ = ["ARTEFACT_KINDS", "Artefact", "ArtefactTable", "artefact_from_table"]

ARTEFACT_KINDS: Mapping[str, type[Artefact]] = {
    "cone": Cone,
    "seats": Seats,
    "ball_bar": BallBar,
    "sphere": Sphere,
    "plane": Plane,
    "parallel_planes": ParallelPlanes,
    "points": Points,
    "draw_wire": DrawWire,
}


class ArtefactTable(StrictModel):
    """A table of any kind; the class itself represents an unknown kind, an error."""

    model_config = ConfigDict(extra="ignore")

    kind: str

    @classmethod
    def variant(cls, table: object) -> type[StrictModel]:
        """Return the class of a table by its kind."""
        kind = table.get("kind") if isinstance(table, Mapping) else None
        return ARTEFACT_KINDS.get(str(kind), ArtefactTable)

    @field_validator("kind")
    @classmethod
    def _unknown(cls, kind: str) -> str:
        raise ValueError(unknown_name_message("kind", kind, ARTEFACT_KINDS))


def artefact_from_table(table: object) -> object:
    """Make an artefact of the class for its kind."""
    if isinstance(table, Artefact):
        return table
    return ArtefactTable.variant(table).model_validate(tuples_for_lists(table))
