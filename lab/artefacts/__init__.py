"""The kinds of artefacts: one class and one entry here each."""

from collections.abc import Iterator, Mapping
from importlib import import_module

from pydantic import ConfigDict, field_validator

from traverse.lab.artefacts.artefact import Artefact
from traverse.strict_toml.problems import unknown_name_message
from traverse.strict_toml.reader import StrictModel, tuples_for_lists

__all__ = ["ARTEFACT_KINDS", "Artefact", "ArtefactTable", "artefact_from_table"]


class _Kinds(Mapping[str, type[Artefact]]):
    """Classes by kind; a module is imported when its class is first used."""

    _CLASSES: Mapping[str, str] = {
        "cone": "seats.Cone",
        "seats": "seats.Seats",
        "ball_bar": "ball_bar.BallBar",
        "sphere": "sphere.Sphere",
        "plane": "plane.Plane",
        "parallel_planes": "plane.ParallelPlanes",
        "points": "points.Points",
        "draw_wire": "draw_wire.DrawWire",
    }

    def __getitem__(self, kind: str) -> type[Artefact]:
        module, name = self._CLASSES[kind].split(".")
        of_kind: type[Artefact] = getattr(import_module(f"{__name__}.{module}"), name)
        return of_kind

    def __iter__(self) -> Iterator[str]:
        return iter(self._CLASSES)

    def __len__(self) -> int:
        return len(self._CLASSES)


ARTEFACT_KINDS = _Kinds()


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
    if isinstance(table, Artefact):
        return table
    return ArtefactTable.variant(table).model_validate(tuples_for_lists(table))
