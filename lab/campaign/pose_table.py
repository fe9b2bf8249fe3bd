"""Reading a table of poses, by blocks of rows and column by column.

Nothing is half-read: any problem refuses the file.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from operator import itemgetter
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.campaign.csv_rows import csv_rows
from traverse.lab.campaign.poses import Poses
from traverse.plurals import counted
from traverse.strict_toml.problems import (
    LARGEST,
    FileError,
    Problem,
    is_number,
    shown,
    unknown_name_message,
)

# The cells of some rows, column by column.
_Columns = Sequence[tuple[str, ...]]
# Columns of one number, by their attribute of `Poses`.
_NUMBERS = {
    "temperature_c": ("temperature_c",),
    "force_n": ("force_n",),
    "lengths_mm": ("length_mm",),
}
# Columns that are filled together: a vector of length 1, all components or none.
_UNIT_VECTORS = {
    "directions": tuple(f"direction_{axis}" for axis in "xyz"),
    "orientations": tuple(f"orientation_{part}" for part in "wxyz"),
}


@dataclass(frozen=True, slots=True)
class PoseColumns:
    """Where the columns of a file are; indices count from 0.

    Attributes:
        angles: Of every joint's angle, in the order of the arm.
        optional: Index by name of every optional column that is there.
        quantities: Optional columns by their attribute of `Poses`, as far as any of
            them is there.
        tool: Of tool, where it is there.
        tools: What that column may name.
    """

    names: tuple[str, ...]
    time: int
    artefact: int
    feature: int
    angles: tuple[int, ...]
    optional: dict[str, int]
    quantities: dict[str, tuple[str, ...]]
    tool: int | None = None
    tools: tuple[str, ...] = ()

    @property
    def numeric(self) -> tuple[int, ...]:
        """Columns that must hold a finite number in each row."""
        return (self.time, *self.angles)


def columns_from_header(
    header: Sequence[str], joint_names: Sequence[str], tools: Sequence[str] = ()
) -> PoseColumns | list[Problem]:
    """Find the columns, or say all that is wrong with the header."""
    problems = list(_header_problems(header, joint_names))
    if problems:
        return problems
    places = {name: index for index, name in enumerate(header)}
    quantities = optional_columns(joint_names)
    optional = {name for names in quantities.values() for name in names}
    return PoseColumns(
        names=tuple(header),
        time=places["time_s"],
        artefact=places["artefact"],
        feature=places["feature"],
        angles=tuple(places[f"{name}_rad"] for name in joint_names),
        optional={name: at for name, at in places.items() if name in optional},
        quantities={
            quantity: names
            for quantity, names in quantities.items()
            if not places.keys().isdisjoint(names)
        },
        tool=places.get("tool"),
        tools=tuple(tools),
    )


def optional_columns(joint_names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Name the columns that a table may have besides, by attribute of `Poses`."""
    return {
        **_NUMBERS,
        **_UNIT_VECTORS,
        "joint_temperatures_c": tuple(f"{name}_temperature_c" for name in joint_names),
        "approaches": tuple(f"{name}_approach" for name in joint_names),
        "speeds_rad_s": tuple(f"{name}_speed_rad_s" for name in joint_names),
    }


def _header_problems(
    header: Sequence[str], joint_names: Sequence[str]
) -> Iterator[Problem]:
    required = ("time_s", "artefact", "feature", *(f"{n}_rad" for n in joint_names))
    optional = optional_columns(joint_names).values()
    known = (*required, "tool", *(name for names in optional for name in names))
    for name in required:
        if name not in header:
            yield Problem("line 1", f"column '{name}' is missing; add it")
    for index, name in enumerate(header):
        if name in header[:index]:
            yield Problem("line 1", f"column '{name}' stands there twice")
        elif name not in known:
            yield Problem("line 1", unknown_name_message("column", name, known))
    for names in _UNIT_VECTORS.values():
        there = [name for name in names if name in header]
        if there and len(there) < len(names):
            missing = ", ".join(name for name in names if name not in header)
            yield Problem("line 1", f"{there[0]} needs {missing} beside it")


_BLOCK_ROWS = 20_000
# More problems than anybody reads; the rest is counted.
_MOST_PROBLEMS = 100


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """What a file contains.

    Attributes:
        poses: Their artefacts and features are indices into those of the campaign's
            file; for artefacts without a list of features into `free_features`.
        free_features: Names met at artefacts without a list of features.
        start_utc: Zero of the poses' times, where the table itself contains it.
        notes: What is not as it should be, but no reason to refuse.
    """

    poses: Poses
    free_features: tuple[str, ...]
    start_utc: datetime | None = None
    notes: tuple[str, ...] = ()


def read_pose_table(
    path: Path,
    joint_names: Sequence[str],
    features: Mapping[str, tuple[str, ...]],
    tools: Sequence[str] = (),
) -> PoseTable:
    """Read a table of poses.

    Args:
        path: The CSV file.
        joint_names: Of the arm, in order.
        features: The features that each artefact has, by its id; none: any.
        tools: What the column `tool` may name.

    Raises:
        FileError: With the lines that cannot be used.
    """
    with csv_rows(path, "poses") as (header, rows):
        columns = columns_from_header(header, joint_names, tools)
        if isinstance(columns, list):
            raise FileError(path, columns)
        numeric = (*columns.numeric, *columns.optional.values())
        reader, lines = _RowReader(columns, features), rows(numeric)
        while block := list(islice(lines, _BLOCK_ROWS)):
            reader.read(block)
    if problems := reader.problems():
        raise FileError(path, problems)
    return reader.table()


class _RowReader:
    """Turns rows into numbers and indices, and collects what is wrong with them.

    Args:
        columns: Where the columns are.
        features: The features that each artefact has, by its id; none: any.
    """

    def __init__(
        self, columns: PoseColumns, features: Mapping[str, tuple[str, ...]]
    ) -> None:
        self._columns = columns
        self._features = features
        self._artefacts = {name: index for index, name in enumerate(features)}
        self._known = {
            (name, feature): index
            for name, listed in features.items()
            for index, feature in enumerate(listed)
        }
        self._free: dict[str, int] = {}
        self._blocks: list[tuple[Integers, Integers, Integers, Floats]] = []
        self._problems: list[Problem] = []
        self._n_problems, self._line = 0, 2

    def read(self, rows: Sequence[Sequence[str]]) -> None:
        """Read the next rows of the file."""
        expected = len(self._columns.names)
        wrong: list[tuple[int, str]] = []
        whole = []
        for at, cells in enumerate(rows):
            if len(cells) == expected:
                whole.append(at)
            else:
                wrong.append((at, _wrong_length(len(cells), expected)))
        if whole:
            by_column = list(zip(*(rows[at] for at in whole), strict=True))
            numbers, messages = self._numbers(by_column)
            messages = [*self._name_problems(by_column), *messages]
            wrong += [(whole[at], message) for at, message in messages]
            self._blocks.append((*self._indices(by_column), numbers))
        self._problems += [
            Problem(f"line {self._line + at}", message)
            for at, message in sorted(wrong, key=itemgetter(0))
        ][: _MOST_PROBLEMS - len(self._problems)]
        self._n_problems += len(wrong)
        self._line += len(rows)

    def problems(self) -> list[Problem]:
        """List what is wrong with all that was read."""
        if not self._n_problems and not self._blocks:
            return [Problem("", "holds no poses; measure some")]
        more = self._n_problems - len(self._problems)
        rest = [Problem("", f"and {more} more problems like these")] if more else []
        return self._problems + rest

    def table(self) -> PoseTable:
        """Return all that was read, where nothing is wrong."""
        columns = self._columns
        artefacts, features, tools, numbers = (
            np.concatenate(part) for part in zip(*self._blocks, strict=True)
        )
        poses = Poses(
            lines=np.arange(2, len(numbers) + 2),
            time_s=numbers[:, columns.time],
            artefacts=artefacts,
            features=features,
            angles_rad=np.ascontiguousarray(numbers[:, columns.angles]),
            tools=tools if np.any(tools) else None,
            **{
                quantity: self._optional(numbers, quantity)
                for quantity in columns.quantities
            },
        )
        return PoseTable(poses, tuple(self._free))

    def _optional(self, numbers: Floats, quantity: str) -> Floats:
        """Put the columns of a quantity side by side, NaN for those that lack."""
        at = self._columns.optional
        empty = np.full(len(numbers), np.nan)
        values: Floats = np.column_stack(
            [
                numbers[:, at[name]] if name in at else empty
                for name in self._columns.quantities[quantity]
            ]
        )
        if quantity in _UNIT_VECTORS:
            values /= np.linalg.norm(values, axis=1, keepdims=True)
        return values[:, 0] if quantity in _NUMBERS else values

    def _name_problems(self, by_column: _Columns) -> Iterator[tuple[int, str]]:
        """Yield the rows whose artefact, feature or tool is not known."""
        columns, features = self._columns, self._features
        unknown: dict[tuple[str, str], str] = {}
        pairs = list(
            zip(by_column[columns.artefact], by_column[columns.feature], strict=True)
        )
        for artefact, feature in dict.fromkeys(pairs):
            if artefact not in features:
                message = unknown_name_message("artefact", artefact, features)
                unknown[artefact, feature] = message
            elif not features[artefact]:
                number = self._free.setdefault(feature, len(self._free))
                self._known[artefact, feature] = number
            elif feature not in features[artefact]:
                message = unknown_name_message("feature", feature, features[artefact])
                unknown[artefact, feature] = f"{message} ({artefact})"
        if unknown:
            yield from ((at, unknown[p]) for at, p in enumerate(pairs) if p in unknown)
        tools = () if columns.tool is None else by_column[columns.tool]
        if set(tools) - {"", *columns.tools}:
            for at, tool in enumerate(tools):
                if tool and tool not in columns.tools:
                    message = unknown_name_message("tool", tool, columns.tools)
                    remedy = "say it in [[tools]] of campaign.toml, or leave it empty"
                    yield at, f"{message}; {remedy}"

    def _indices(self, by_column: _Columns) -> tuple[Integers, Integers, Integers]:
        """Return artefacts, features and tools by number; 0 for an unknown name."""
        columns = self._columns
        names, features = by_column[columns.artefact], by_column[columns.feature]
        numbers = {name: at for at, name in enumerate(columns.tools, start=1)}
        tools = ("",) * len(names) if columns.tool is None else by_column[columns.tool]
        return (
            np.array([self._artefacts.get(n, 0) for n in names], dtype=np.int64),
            np.array(
                [self._known.get(p, 0) for p in zip(names, features, strict=True)],
                dtype=np.int64,
            ),
            np.array([numbers.get(tool, 0) for tool in tools], dtype=np.int64),
        )

    def _numbers(self, by_column: _Columns) -> tuple[Floats, list[tuple[int, str]]]:
        """Convert the columns of numbers, (n_rows, n_columns); and what is wrong."""
        columns, wrong = self._columns, list[tuple[int, str]]()
        numbers = np.full((len(by_column[0]), len(by_column)), np.nan)
        optional = set(columns.optional.values())
        for index in (*columns.numeric, *columns.optional.values()):
            name, cells = columns.names[index], by_column[index]
            numbers[:, index] = values = _converted(cells)
            may_be = "; or leave it empty" if index in optional else ""
            wrong += [
                (at, f"{name} is {shown(cells[at])}, not a finite number{may_be}")
                for at in np.flatnonzero(np.isnan(values)).tolist()
                if cells[at] or not may_be
            ]
            if name in columns.optional and name.endswith("_approach"):
                off = ~np.isnan(values) & ~np.isin(values, (-1.0, 0.0, 1.0))
                wrong += [
                    (at, f"{name} is {shown(cells[at])}; expected -1, 0 or 1")
                    for at in np.flatnonzero(off).tolist()
                ]
        for quantity, names in _UNIT_VECTORS.items():
            if quantity in columns.quantities:
                at = [columns.optional[name] for name in names]
                texts = [by_column[index] for index in at]
                what = quantity.removesuffix("s")
                wrong += _unit_vector_problems(what, texts, numbers[:, at])
        return numbers, wrong


def _wrong_length(found: int, expected: int) -> str:
    if not found:
        return f"is empty; expected {expected}, as in the header"
    hint = "; decimal commas need ';' or tabs between the columns"
    return (
        f"has {counted(found, 'column')}; expected {expected}, as in the header"
        f"{hint if found > expected else ''}"
    )


def _unit_vector_problems(
    what: str, texts: Sequence[tuple[str, ...]], vectors: Floats
) -> Iterator[tuple[int, str]]:
    """Yield the rows in which a vector, (n_rows, 3 or 4), is not one of length 1."""
    size = vectors.shape[1]
    each = {3: "three", 4: "four"}[size]
    hint = "" if size == 3 else ": a unit quaternion w, x, y, z"
    for at in np.flatnonzero(np.isnan(vectors).any(axis=1)).tolist():
        cells = [column[at] for column in texts]
        if any(cells) and not all(cells):
            yield at, f"{what} is {shown(cells)}; give all {each} components or none"
    # Of cells that are no numbers there is no length.
    lengths = np.linalg.norm(vectors, axis=1)
    for at in np.flatnonzero(np.abs(lengths - 1.0) >= 1e-3).tolist():
        yield at, f"{what} has the length {lengths[at]:.6g}; expected 1{hint}"


def _converted(cells: Sequence[str]) -> Floats:
    """Convert cells, (n,): fast where nothing is wrong; NaN for what is no number."""
    try:
        if not any("_" in cell for cell in cells):
            known = [cell or "nan" for cell in cells] if "" in cells else cells
            values = np.array(known, dtype=np.float64)
            return np.where(np.abs(values) <= LARGEST, values, np.nan)
    except ValueError:
        pass
    return np.array([_number(cell) for cell in cells])


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if is_number(number) and "_" not in text else math.nan
