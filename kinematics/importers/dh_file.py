"""Files with a Denavit-Hartenberg table: CSV and TOML, read strictly and written.

A key carries its unit (`a_mm`, `alpha_deg`); one without takes the unit given on the
command line and is refused if there is none. Errors are returned as pairs of the
key and a message; the caller adds the place in the file.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.effect_table import Vector
from traverse.kinematics.importers.arm_values import (
    MM_DECIMALS,
    RAD_DECIMALS,
    rounded,
)
from traverse.kinematics.importers.dh import Convention, DHTable
from traverse.kinematics.importers.unit_doubts import angle_doubt, degrees_doubt
from traverse.kinematics.importers.urdf import roll_pitch_yaw
from traverse.strict_toml.problems import (
    Problem,
    number_in,
    shown,
    tables_in,
    toml_text,
    unknown_name_message,
)
from traverse.strict_toml.reader import StrictModel, parse_strict
from traverse.tables.numbers import Unit, part_of_pi
from traverse.tables.reading import Table, open_table

_LENGTHS = {"mm": 1.0, "m": 1000.0}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
_QUANTITIES = {
    "a": _LENGTHS,
    "d": _LENGTHS,
    "alpha": _ANGLES,
    "theta": _ANGLES,
    "base": _ANGLES,
}
_REQUIRED = ("a", "d", "alpha")
_FILLED = ("a_mm", "d_mm", "alpha_rad")
_PLAIN = ("name", "counts_per_turn", "sign", "source")
_KNOWN = [
    *_PLAIN,
    *(f"{q}_{unit}" for q, units in _QUANTITIES.items() for unit in units),
]
_INTEGERS = {"counts_per_turn": "an integer from 1 to 2^32", "sign": "1 or -1"}

# In mm or rad: nothing of an arm is larger, and sums stay finite.
_LARGEST = 1e9

Wrong = list[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Units:
    """Units of keys that do not name theirs: "mm" or "m", "rad" or "deg"."""

    lengths: str | None = None
    angles: str | None = None


@dataclass(frozen=True, slots=True)
class DHRow:
    """One joint of a table.

    Attributes:
        base_rad: Its reading in the base posture.
        angles: Keys of all angles that the file gives, each with its value in rad
            and whether it was given in degrees.
    """

    a_mm: float
    d_mm: float
    alpha_rad: float
    theta_rad: float = 0.0
    base_rad: float = 0.0
    name: str | None = None
    counts_per_turn: int | None = None
    sign: int | None = None
    source: str | None = None
    angles: tuple[tuple[str, float, bool], ...] = ()


@dataclass(frozen=True, slots=True)
class Column:
    """Content of a key: a field of `DHRow` in units of `factor`; 0 for a plain one."""

    field: str
    factor: float


def columns_of(keys: Iterable[str], units: Units) -> tuple[dict[str, Column], Wrong]:
    """Map the keys of a row, or of a header, to their columns."""
    columns: dict[str, Column] = {}
    wrong: Wrong = []
    header_of: dict[str, str] = {}
    for key in keys:
        try:
            column = _column(key, units)
        except ValueError as error:
            wrong.append((key, str(error)))
            # A key that cannot be used is not missing too.
            header_of.setdefault(key.partition("_")[0], key)
            continue
        if column.field in header_of:
            wrong.append((key, f"says again what '{header_of[column.field]}' says"))
        else:
            columns[key] = column
        header_of.setdefault(column.field, key)
    for quantity in _REQUIRED:
        field = f"{quantity}_{next(iter(_QUANTITIES[quantity]))}"
        if field not in header_of and quantity not in header_of:
            wrong.append((field, "is missing; add it"))
    return columns, wrong


def row_of(
    values: Mapping[str, object], columns: Mapping[str, Column]
) -> tuple[DHRow | None, Wrong]:
    """Take one row.

    Args:
        values: Value of each key; one that is None counts as absent.
        columns: By the keys; other keys are passed over.

    Returns:
        The row, nothing if anything is wrong; and all that is.
    """
    fields: dict[str, object] = {}
    wrong: Wrong = []
    for key, column in columns.items():
        value = values.get(key)
        if value is None:
            continue
        try:
            fields[column.field] = _field_value(column, value)
        except ValueError as error:
            wrong.append((key, str(error)))
    if wrong or any(field not in fields for field in _FILLED):
        return None, wrong
    fields["angles"] = tuple(
        (key, fields[column.field], column.factor != 1.0)
        for key, column in columns.items()
        if column.field.endswith("_rad") and column.field in fields
    )
    return DHRow(**fields), wrong  # type: ignore[arg-type]  # checked field by field


def _column(key: str, units: Units) -> Column:
    if key in _PLAIN:
        return Column(key, 0.0)
    quantity, _, unit = key.partition("_")
    factors = _QUANTITIES.get(quantity)
    if factors is not None and not unit:
        option, unit_in_file = (
            ("--lengths", units.lengths)
            if factors is _LENGTHS
            else ("--angles", units.angles)
        )
        if unit_in_file is None:
            named = " or ".join(f"'{quantity}_{known}'" for known in factors)
            either = " or ".join(factors)
            raise ValueError(f"has no unit; name it {named}, or give {option} {either}")
        unit = unit_in_file
    if factors is None or unit not in factors:
        raise ValueError(unknown_name_message("key", key, _KNOWN))
    return Column(f"{quantity}_{next(iter(factors))}", factors[unit])


def _field_value(column: Column, value: object) -> float | int | str:
    if column.field in _INTEGERS:
        good = (1, -1) if column.field == "sign" else range(1, 2**32 + 1)
        if isinstance(value, bool) or not isinstance(value, int) or value not in good:
            raise ValueError(f"{shown(value)} is not {_INTEGERS[column.field]}")
        return value
    if column.factor == 0.0:
        if not isinstance(value, str):
            raise ValueError(f"{shown(value)} is not a string; put it in quotes")
        return value
    quantity = number_in(value)
    is_angle = column.field.endswith("_rad")
    if quantity is None and column.factor == 1.0 and is_angle:
        quantity = part_of_pi(value) if isinstance(value, str) else None
    if quantity is not None and abs(quantity * column.factor) <= _LARGEST:
        return quantity * column.factor
    why = f"{shown(value)} is not a finite number"
    if quantity is not None:
        why = f"{shown(value)} is beyond any arm; mind the unit"
    elif is_angle:
        in_rad = column.factor == 1.0
        why += " or a part of pi such as -pi/2" if in_rad else " of degrees"
    raise ValueError(why)


class Placement(StrictModel):
    """Pose of a coordinate frame; roll, pitch and yaw as in a URDF."""

    xyz_mm: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class DHFile:
    """A table as its file states it; None where the file is silent."""

    rows: tuple[DHRow, ...]
    convention: Convention | None = None
    name: str | None = None
    base: Placement | None = None
    tool: Placement | None = None

    def doubts(self) -> Iterator[str]:
        """Yield questions about implausible angles."""
        for number, row in enumerate(self.rows, 1):
            for key, angle_rad, in_degrees in row.angles:
                what = f"{key} of {row.name or f'J{number}'}"
                yield from (degrees_doubt if in_degrees else angle_doubt)(
                    what, angle_rad
                )


class _TomlTable(StrictModel):
    schema_: Literal["traverse/dh/1"] = Field(alias="schema")
    convention: Convention | None = None
    name: str | None = None
    base: Placement | None = None
    tool: Placement | None = None
    rows: tuple[dict[str, Any], ...]


def read_dh_file(path: Path, units: Units) -> DHFile:
    """Read a table: TOML where the file's name ends so, else CSV.

    Raises:
        FileError: With everything that is wrong, by line or key path.
    """
    if path.suffix.lower() == ".toml":
        return _parse_toml(toml_text(path), str(path), units)
    with open_table(path) as table:
        return DHFile(_rows_of_table(table, units))


def _parse_toml(text: str, source: str, units: Units) -> DHFile:
    rows: list[DHRow] = []

    def row_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
        if raw.get("rows") == []:
            yield Problem("rows", "is empty; a table has a row for each joint")
        for index, values in enumerate(tables_in(raw.get("rows"))):
            columns, wrong_keys = columns_of(values, units)
            row, wrong_values = row_of(values, columns)
            for key, message in wrong_keys + wrong_values:
                yield Problem(f"rows[{index}].{key}", message)
            rows.extend([row] if row else [])

    table = parse_strict(text, source, _TomlTable, row_problems)
    return DHFile(tuple(rows), table.convention, table.name, table.base, table.tool)


def _rows_of_table(table: Table, units: Units) -> tuple[DHRow, ...]:
    """Read the rows of a table in CSV.

    Raises:
        FileError: With everything that is wrong.
    """
    columns, wrong = columns_of(table.header, units)
    for key, why in wrong:
        table.refuse_header(why, key)
    filled = [key for key, column in columns.items() if column.field in _FILLED]
    rows: list[DHRow] = []
    for line, cells in table.rows_by_name(filled):
        for key in filled:
            if not cells[key]:
                table.refuse(line, "is empty; give a number", key)
        values = {
            key: _cell_value(table, line, key, column, cells[key])
            for key, column in columns.items()
            if cells[key]
        }
        row, wrong = row_of(values, columns)
        for key, why in wrong:
            table.refuse(line, why, key)
        rows.extend([row] if row else [])
    table.check()
    if not rows:
        table.refuse(0, "holds no table: a header line and then a line for each joint")
        table.check()
    return tuple(rows)


def _cell_value(
    table: Table, line: int, key: str, column: Column, cell: str
) -> float | int | str | None:
    """Read a cell; None where it is no number, which is refused."""
    if column.field in _INTEGERS:
        number = table.integer(line, cell)
        return cell if number is None else number
    if column.factor == 0.0:
        return cell
    unit: Unit = "other"
    if column.field.endswith("_rad"):
        unit = "rad" if column.factor == 1.0 else "deg"
    return table.number(line, key, cell, unit)


def dh_csv(table: DHTable, names: Sequence[str], base_rad: Sequence[float]) -> str:
    """Write a classic table as CSV; base and tool are in a comment, as options."""
    rows = _rows(table, names, base_rad)
    lines = [
        "# classic; theta_rad where the reading is zero, base_rad the base posture.",
        "# CSV has no place for these, give them to `traverse arm from-dh`:",
        f"#   --convention {table.convention} {_options('base', table.base)} \\",
        f"#   {_options('tool', table.tool)}",
        "name,a_mm,d_mm,alpha_rad,theta_rad,base_rad",
        *(",".join(map(str, row.values())) for row in rows),
    ]
    return "\n".join(lines) + "\n"


def dh_values(
    arm: str, table: DHTable, names: Sequence[str], base_rad: Sequence[float]
) -> dict[str, Any]:
    return {
        "schema": "traverse/dh/1",
        "convention": table.convention,
        "name": arm,
        "base": _placement(table.base),
        "tool": _placement(table.tool),
        "rows": _rows(table, names, base_rad),
    }


def _rows(
    table: DHTable, names: Sequence[str], base_rad: Sequence[float]
) -> list[dict[str, Any]]:
    columns = {
        "name": names,
        "a_mm": rounded(table.a_mm, MM_DECIMALS),
        "d_mm": rounded(table.d_mm, MM_DECIMALS),
        "alpha_rad": rounded(table.alpha_rad, RAD_DECIMALS),
        "theta_rad": rounded(table.theta_rad, RAD_DECIMALS),
        "base_rad": [float(angle_rad) for angle_rad in base_rad],
    }
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _placement(transform: Floats) -> dict[str, Any]:
    return {
        "xyz_mm": rounded(transform[:3, 3], MM_DECIMALS),
        "rpy_rad": rounded(roll_pitch_yaw(transform[:3, :3]), RAD_DECIMALS),
    }


def _options(option_stem: str, transform: Floats) -> str:
    placed = _placement(transform)
    xyz, rpy = (",".join(map(str, placed[key])) for key in ("xyz_mm", "rpy_rad"))
    return f"--{option_stem}-xyz-mm={xyz} --{option_stem}-rpy-rad={rpy}"
