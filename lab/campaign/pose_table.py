"""Reading a table of poses, by blocks of rows and column by column.

Nothing is half-read: any problem refuses the file.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.campaign.poses import Poses
from traverse.strict_toml.problems import FileError, shown, unknown_name_message
from traverse.tables.reading import Table, open_table

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
) -> PoseColumns | list[str]:
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
        optional={name: column for name, column in places.items() if name in optional},
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
) -> Iterator[str]:
    required = ("time_s", "artefact", "feature", *(f"{n}_rad" for n in joint_names))
    optional = optional_columns(joint_names).values()
    known = (*required, "tool", *(name for names in optional for name in names))
    for name in required:
        if name not in header:
            yield f"column '{name}' is missing; add it"
    for name in header:
        if name not in known:
            yield unknown_name_message("column", name, known)
    for names in _UNIT_VECTORS.values():
        present = [name for name in names if name in header]
        if present and len(present) < len(names):
            missing = ", ".join(name for name in names if name not in header)
            yield f"{present[0]} needs {missing} beside it"


_BLOCK_ROWS = 20_000
# Of a joint between two readings; degrees in place of radians are more.
_MOST_TURNS = 3.0


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
        path: The file.
        joint_names: Of the arm, in order.
        features: The features that each artefact has, by its id; none: any.
        tools: What the column `tool` may name.

    Raises:
        FileError: With the lines that cannot be used.
    """
    with open_table(path) as table:
        columns = columns_from_header(table.header, joint_names, tools)
        if isinstance(columns, list):
            for problem in columns:
                table.refuse_header(problem)
            table.check()
        else:
            reader = _RowReader(table, columns, features)
            filled = [table.header[index] for index in columns.numeric]
            lines = table.rows(filled)
            while block := list(islice(lines, _BLOCK_ROWS)):
                reader.read(block)
            table.check()
            if reader.n_rows:
                return reader.table()
    raise FileError(path, "holds no poses; measure some")


class _RowReader:
    """Turns rows into numbers and indices, and collects what is wrong with them.

    Args:
        table: That is read; notes what is wrong.
        columns: Where the columns are.
        features: The features that each artefact has, by its id; none: any.
    """

    def __init__(
        self,
        table: Table,
        columns: PoseColumns,
        features: Mapping[str, tuple[str, ...]],
    ) -> None:
        self._table = table
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
        self._lines: list[int] = []

    @property
    def n_rows(self) -> int:
        return len(self._lines)

    def read(self, rows: Sequence[tuple[int, Sequence[str]]]) -> None:
        """Read the next rows of the file, with the numbers of their lines."""
        lines = [line for line, _ in rows]
        by_column = list(zip(*(cells for _, cells in rows), strict=True))
        for row, message in self._name_problems(by_column):
            self._table.refuse(lines[row], message)
        numbers = self._numbers(lines, by_column)
        self._blocks.append((*self._indices(by_column), numbers))
        self._lines += lines

    def table(self) -> PoseTable:
        """Return all that was read, where nothing is wrong."""
        columns = self._columns
        artefacts, features, tools, numbers = (
            np.concatenate(part) for part in zip(*self._blocks, strict=True)
        )
        poses = Poses(
            lines=np.array(self._lines, dtype=np.int64),
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
        return PoseTable(poses, tuple(self._free), notes=tuple(self._doubts(poses)))

    def _doubts(self, poses: Poses) -> Iterator[str]:
        """Ask about angles that can hardly be meant."""
        largest_rad = np.abs(poses.angles_rad).max(axis=0)
        for index, angle_rad in zip(self._columns.angles, largest_rad, strict=True):
            if angle_rad > _MOST_TURNS * 2.0 * np.pi:
                name = self._columns.names[index]
                yield f"{name} reaches {angle_rad:g}, many turns in radians: degrees?"

    def _optional(self, numbers: Floats, quantity: str) -> Floats:
        """Put the columns of a quantity side by side, NaN for those that lack."""
        columns = self._columns.optional
        empty = np.full(len(numbers), np.nan)
        values: Floats = np.column_stack(
            [
                numbers[:, columns[name]] if name in columns else empty
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
            yield from (
                (index, unknown[p]) for index, p in enumerate(pairs) if p in unknown
            )
        tools = () if columns.tool is None else by_column[columns.tool]
        if set(tools) - {"", *columns.tools}:
            for index, tool in enumerate(tools):
                if tool and tool not in columns.tools:
                    message = unknown_name_message("tool", tool, columns.tools)
                    remedy = "say it in [[tools]] of campaign.toml, or leave it empty"
                    yield index, f"{message}; {remedy}"

    def _indices(self, by_column: _Columns) -> tuple[Integers, Integers, Integers]:
        """Return artefacts, features and tools by number; 0 for an unknown name."""
        columns = self._columns
        names, features = by_column[columns.artefact], by_column[columns.feature]
        numbers = {name: index for index, name in enumerate(columns.tools, start=1)}
        tools = ("",) * len(names) if columns.tool is None else by_column[columns.tool]
        return (
            np.array([self._artefacts.get(n, 0) for n in names], dtype=np.int64),
            np.array(
                [self._known.get(p, 0) for p in zip(names, features, strict=True)],
                dtype=np.int64,
            ),
            np.array([numbers.get(tool, 0) for tool in tools], dtype=np.int64),
        )

    def _numbers(self, lines: Sequence[int], by_column: _Columns) -> Floats:
        """Convert the columns of numbers, (n_rows, n_columns)."""
        columns, table = self._columns, self._table
        numbers = np.full((len(lines), len(by_column)), np.nan)
        for index in (*columns.numeric, *columns.optional.values()):
            name, cells = columns.names[index], by_column[index]
            values, wrong = table.numbers(lines, name, cells)
            numbers[:, index] = values
            may_be = "; or leave it empty" if index not in columns.numeric else ""
            for row, message in wrong.items():
                table.refuse(lines[row], f"{message}{may_be}", name)
            if not may_be:
                for row in (row for row, cell in enumerate(cells) if not cell):
                    table.refuse(lines[row], "is empty; give a number", name)
            if name in columns.optional and name.endswith("_approach"):
                off = ~np.isnan(values) & ~np.isin(values, (-1.0, 0.0, 1.0))
                for row in np.flatnonzero(off).tolist():
                    problem = f"is {shown(cells[row])}; expected -1, 0 or 1"
                    table.refuse(lines[row], problem, name)
        for quantity, names in _UNIT_VECTORS.items():
            if quantity in columns.quantities:
                places = [columns.optional[name] for name in names]
                texts = [by_column[index] for index in places]
                vectors = numbers[:, places]
                singular = quantity.removesuffix("s")
                for row, message in _unit_vector_problems(singular, texts, vectors):
                    table.refuse(lines[row], message)
        return numbers


def _unit_vector_problems(
    quantity: str, texts: Sequence[tuple[str, ...]], vectors: Floats
) -> Iterator[tuple[int, str]]:
    """Yield the rows in which a vector, (n_rows, 3 or 4), is not one of length 1."""
    size = vectors.shape[1]
    each = {3: "three", 4: "four"}[size]
    hint = "" if size == 3 else ": a unit quaternion w, x, y, z"
    for index in np.flatnonzero(np.isnan(vectors).any(axis=1)).tolist():
        cells = [column[index] for column in texts]
        if any(cells) and not all(cells):
            yield (
                index,
                f"{quantity} is {shown(cells)}; give all {each} components or none",
            )
    # Of cells that are no numbers there is no length.
    lengths = np.linalg.norm(vectors, axis=1)
    for index in np.flatnonzero(np.abs(lengths - 1.0) >= 1e-3).tolist():
        yield index, f"{quantity} has the length {lengths[index]:.6g}; expected 1{hint}"
