"""Reading a table of poses: by blocks of columns, fast where nothing is wrong.

A block that does not convert whole is parsed cell by cell, only to report what
is wrong in which line. Nothing is half-read: any problem refuses the file.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.campaign.csv_rows import csv_rows
from traverse.plurals import counted
from traverse.strict_toml.problems import (
    LARGEST,
    FileError,
    Problem,
    is_number,
    shown,
    unknown_name_message,
)

# Columns that are filled together: a vector of length 1, all components or none.
_UNIT_VECTORS = {
    "direction": tuple(f"direction_{axis}" for axis in "xyz"),
    "orientation": tuple(f"orientation_{part}" for part in "wxyz"),
}


@dataclass(frozen=True, slots=True)
class PoseColumns:
    """Where the columns of a file are; indices count from 0.

    Attributes:
        angles: Of every joint's angle, in the order of the arm.
        optional: Index by name of every optional column that is there.
        tool: Of tool, where it is there.
        tools: What that column may name.
    """

    names: tuple[str, ...]
    time: int
    artefact: int
    feature: int
    angles: tuple[int, ...]
    optional: dict[str, int]
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
    optional = set(optional_columns(joint_names))
    return PoseColumns(
        names=tuple(header),
        time=places["time_s"],
        artefact=places["artefact"],
        feature=places["feature"],
        angles=tuple(places[f"{name}_rad"] for name in joint_names),
        optional={name: at for name, at in places.items() if name in optional},
        tool=places.get("tool"),
        tools=tuple(tools),
    )


def optional_columns(joint_names: Sequence[str]) -> tuple[str, ...]:
    """List the columns that a table may have beyond the required ones."""
    return (
        "temperature_c",
        "force_n",
        "length_mm",
        *(name for names in _UNIT_VECTORS.values() for name in names),
        *(f"{name}_temperature_c" for name in joint_names),
        *(f"{name}_approach" for name in joint_names),
        *(f"{name}_speed_rad_s" for name in joint_names),
    )


def _header_problems(
    header: Sequence[str], joint_names: Sequence[str]
) -> Iterator[Problem]:
    required = ("time_s", "artefact", "feature", *(f"{n}_rad" for n in joint_names))
    known = (*required, "tool", *optional_columns(joint_names))
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


def row_problems(
    rows: Sequence[Sequence[str]],
    first_line: int,
    columns: PoseColumns,
    features: Mapping[str, tuple[str, ...]],
) -> Iterator[Problem]:
    """Yield what is wrong with some rows.

    Args:
        rows: Cells.
        first_line: Line of the first row in the file, from 1.
        columns: Where the columns are.
        features: The features that each artefact has, by its id; none: any.
    """
    for line, cells in enumerate(rows, first_line):
        where = f"line {line}"
        if len(cells) != len(columns.names):
            found = "is empty" if not cells else f"has {counted(len(cells), 'column')}"
            expected = f"expected {len(columns.names)}, as in the header"
            if len(cells) > len(columns.names):
                expected += "; decimal commas need ';' or tabs between the columns"
            yield Problem(where, f"{found}; {expected}")
            continue
        for message in _cell_messages(cells, columns, features):
            yield Problem(where, message)


def _cell_messages(
    cells: Sequence[str],
    columns: PoseColumns,
    features: Mapping[str, tuple[str, ...]],
) -> Iterator[str]:
    artefact, feature = cells[columns.artefact], cells[columns.feature]
    if artefact not in features:
        yield unknown_name_message("artefact", artefact, features)
    elif features[artefact] and feature not in features[artefact]:
        yield (
            unknown_name_message("feature", feature, features[artefact])
            + f" ({artefact})"
        )
    tool = "" if columns.tool is None else cells[columns.tool]
    if tool and tool not in columns.tools:
        message = unknown_name_message("tool", tool, columns.tools)
        yield f"{message}; say it in [[tools]] of campaign.toml, or leave it empty"
    for index in columns.numeric:
        if _number(cells[index]) is None:
            found = shown(cells[index])
            yield f"{columns.names[index]} is {found}, not a finite number"
    for name, index in columns.optional.items():
        if not cells[index]:
            continue
        number = _number(cells[index])
        if number is None:
            found = shown(cells[index])
            yield f"{name} is {found}, not a finite number; or leave it empty"
        elif name.endswith("_approach") and number not in (-1.0, 0.0, 1.0):
            yield f"{name} is {shown(cells[index])}; expected -1, 0 or 1"
    for what in _UNIT_VECTORS:
        yield from _unit_vector_messages(what, cells, columns)


def _unit_vector_messages(
    what: str, cells: Sequence[str], columns: PoseColumns
) -> Iterator[str]:
    names = _UNIT_VECTORS[what]
    if names[0] not in columns.optional:
        return
    texts = [cells[columns.optional[name]] for name in names]
    if not any(texts):
        return
    if not all(texts):
        each = {3: "three", 4: "four"}[len(names)]
        yield f"{what} is {shown(texts)}; give all {each} components or none"
        return
    numbers = [_number(text) for text in texts]
    known = [number for number in numbers if number is not None]
    length = math.hypot(*known)
    if len(known) == len(names) and not abs(length - 1.0) < 1e-3:
        hint = "" if len(names) == 3 else ": a unit quaternion w, x, y, z"
        yield f"{what} has the length {length:.6g}; expected 1{hint}"


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if is_number(number) and "_" not in text else None


_BLOCK_ROWS = 20_000
# More problems than anybody reads; the rest is counted.
_MOST_PROBLEMS = 100


@dataclass(frozen=True, slots=True, eq=False)
class PoseTable:
    """The columns of a file.

    Attributes:
        artefacts: Index into the campaign's artefacts, (n_poses,).
        features: Index into the artefact's features; for artefacts without a list
            of features an index into `free_features`, (n_poses,).
        free_features: Names met at artefacts without a list of features.
        time_s: (n_poses,).
        angles_rad: (n_poses, n_joints).
        optional: Numbers by name of optional column, NaN where empty, (n_poses,).
        lines: Of the file, or numbers of the samples of a stream, from 1, (n_poses,).
        start_utc: Zero of time_s, where the table itself contains it.
        notes: What is not as it should be, but no reason to refuse.
        tools: 0 for the arm's own, else number of the tool, (n_poses,).
    """

    artefacts: Integers
    features: Integers
    free_features: tuple[str, ...]
    time_s: Floats
    angles_rad: Floats
    optional: Mapping[str, Floats]
    lines: Integers
    start_utc: datetime | None = None
    notes: tuple[str, ...] = ()
    tools: Integers | None = None


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
        return _read_rows(path, rows(numeric), columns, features)


def _read_rows(
    path: Path,
    rows: Iterator[list[str]],
    columns: PoseColumns,
    features: Mapping[str, tuple[str, ...]],
) -> PoseTable:
    words = _Words(features)
    blocks: list[tuple[Integers, Integers, Floats]] = []
    used: list[str] = []
    problems: list[Problem] = []
    n_problems, line = 0, 2
    while block := list(islice(rows, _BLOCK_ROWS)):
        numbers = _numbers(block, columns)
        names = None if numbers is None else words.indices(block, columns)
        at = columns.tool
        own = [] if at is None or names is None else [row[at] for row in block]
        if numbers is None or names is None or set(own) - {"", *columns.tools}:
            found = list(row_problems(block, line, columns, features))
            n_problems += len(found)
            problems += found[: _MOST_PROBLEMS - len(problems)]
        else:
            blocks.append((*names, numbers))
            used += own
        line += len(block)
    if n_problems > len(problems):
        more = n_problems - len(problems)
        problems.append(Problem("", f"and {more} more problems like these"))
    if not blocks and not problems:
        problems.append(Problem("", "holds no poses; measure some"))
    if problems:
        raise FileError(path, problems)
    numbers = np.concatenate([block[2] for block in blocks])
    return PoseTable(
        artefacts=np.concatenate([block[0] for block in blocks]),
        features=np.concatenate([block[1] for block in blocks]),
        free_features=words.free_features,
        time_s=numbers[:, columns.time],
        angles_rad=np.ascontiguousarray(numbers[:, columns.angles]),
        optional={name: numbers[:, at].copy() for name, at in columns.optional.items()},
        lines=np.arange(2, len(numbers) + 2),
        tools=np.array([("", *columns.tools).index(tool) for tool in used])
        if any(used)
        else None,
    )


class _Words:
    """Turns names of artefacts and features into indices."""

    def __init__(self, features: Mapping[str, tuple[str, ...]]) -> None:
        self._artefacts = {name: index for index, name in enumerate(features)}
        self._known = {
            (name, feature): index
            for name, listed in features.items()
            for index, feature in enumerate(listed)
        }
        self._unlisted = {name for name, listed in features.items() if not listed}
        self._free: dict[str, int] = {}

    @property
    def free_features(self) -> tuple[str, ...]:
        return tuple(self._free)

    def indices(
        self, block: list[list[str]], columns: PoseColumns
    ) -> tuple[Integers, Integers] | None:
        names = [row[columns.artefact] for row in block]
        pairs = list(zip(names, [row[columns.feature] for row in block], strict=True))
        for pair in set(pairs) - self._known.keys():
            if pair[0] not in self._unlisted:
                return None
            self._known[pair] = self._free.setdefault(pair[1], len(self._free))
        return (
            np.array([self._artefacts[name] for name in names], dtype=np.int64),
            np.array([self._known[pair] for pair in pairs], dtype=np.int64),
        )


def _numbers(block: list[list[str]], columns: PoseColumns) -> Floats | None:
    """Convert a block, (n_rows, n_columns), or nothing where a cell is wrong."""
    n_columns = len(columns.names)
    if any(len(row) != n_columns for row in block):
        return None
    numbers = np.full((len(block), n_columns), np.nan)
    by_column = list(zip(*block, strict=True))
    optional = set(columns.optional.values())
    for index in (*columns.numeric, *optional):
        cells = by_column[index]
        if any("_" in cell for cell in cells):
            return None
        if index in optional:
            cells = tuple(cell or "nan" for cell in cells)
        try:
            numbers[:, index] = np.array(cells, dtype=np.float64)
        except ValueError:
            return None
        empty = sum(not cell for cell in by_column[index])
        if np.count_nonzero(~(np.abs(numbers[:, index]) <= LARGEST)) != empty:
            return None
    return numbers if _rules_hold(numbers, columns) else None


def _rules_hold(numbers: Floats, columns: PoseColumns) -> bool:
    """Check approaches, directions and orientations of a whole block."""
    for name, index in columns.optional.items():
        if name.endswith("_approach"):
            cells = numbers[:, index]
            if not np.all(np.isnan(cells) | np.isin(cells, (-1.0, 0.0, 1.0))):
                return False
    for names in _UNIT_VECTORS.values():
        if names[0] not in columns.optional:
            continue
        at = [columns.optional[name] for name in names]
        lengths = np.linalg.norm(numbers[:, at], axis=1)
        n_empty = np.count_nonzero(np.isnan(numbers[:, at]), axis=1)
        unit = np.abs(np.nan_to_num(lengths) - 1.0) < 1e-3
        if not np.all((n_empty == len(names)) | ((n_empty == 0) & unit)):
            return False
    return True
