"""Which columns a table of poses has, and what may stand in each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from traverse.strict_toml.problems import Problem, unknown_name_message

_DIRECTION = ("direction_x", "direction_y", "direction_z")


@dataclass(frozen=True, slots=True)
class PoseColumns:
    """Where the columns of a file are; indices count from 0.

    Attributes:
        names: The header.
        time: Of time_s.
        artefact: Of artefact.
        feature: Of feature.
        angles: Of every joint's angle, in the order of the arm.
        optional: Index by name of every optional column that is there.
    """

    names: tuple[str, ...]
    time: int
    artefact: int
    feature: int
    angles: tuple[int, ...]
    optional: dict[str, int]

    @property
    def numeric(self) -> tuple[int, ...]:
        """Columns that must hold a finite number in each row."""
        return (self.time, *self.angles)


def columns_from_header(
    header: Sequence[str], joint_names: Sequence[str]
) -> PoseColumns | list[Problem]:
    """Find the columns, or say all that is wrong with the header."""
    problems = list(_header_problems(header, joint_names))
    if problems:
        return problems
    places = {name: index for index, name in enumerate(header)}
    optional = set(optional_columns(joint_names))
    return PoseColumns(
        names=tuple(header),
        time=places["time_s"],
        artefact=places["artefact"],
        feature=places["feature"],
        angles=tuple(places[f"{name}_rad"] for name in joint_names),
        optional={name: at for name, at in places.items() if name in optional},
    )


def optional_columns(joint_names: Sequence[str]) -> tuple[str, ...]:
    """List the columns that a table may have beyond the required ones."""
    return (
        "temperature_c",
        "force_n",
        *_DIRECTION,
        *(f"{name}_temperature_c" for name in joint_names),
        *(f"{name}_approach" for name in joint_names),
        *(f"{name}_speed_rad_s" for name in joint_names),
    )


def _header_problems(
    header: Sequence[str], joint_names: Sequence[str]
) -> Iterator[Problem]:
    required = ("time_s", "artefact", "feature", *(f"{n}_rad" for n in joint_names))
    known = (*required, *optional_columns(joint_names))
    for name in required:
        if name not in header:
            yield Problem("line 1", f"column '{name}' is missing; add it")
    for index, name in enumerate(header):
        if name in header[:index]:
            yield Problem("line 1", f"column '{name}' stands there twice")
        elif name not in known:
            yield Problem("line 1", unknown_name_message("column", name, known))
    there = [name for name in _DIRECTION if name in header]
    if there and len(there) < 3:
        missing = ", ".join(name for name in _DIRECTION if name not in header)
        yield Problem("line 1", f"{there[0]} needs {missing} beside it")
