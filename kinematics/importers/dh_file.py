"""Files with a Denavit-Hartenberg table: CSV and TOML, read strictly and written."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.kinematics.effect_table import Vector
from traverse.kinematics.importers.dh import DHTable
from traverse.kinematics.importers.dh_rows import DHRow, Units, columns_of, row_of
from traverse.kinematics.importers.urdf import roll_pitch_yaw
from traverse.strict_toml.problems import FileError, Problem, toml_text
from traverse.strict_toml.raw_values import tables_in
from traverse.strict_toml.reader import StrictModel, parse_strict
from traverse.strict_toml.writing import arm_text

Convention = Literal["classic", "modified"]


class Placement(StrictModel):
    """Where a coordinate frame stands; roll, pitch and yaw as a URDF has them."""

    xyz_mm: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class DHFile:
    """A table as its file says it; what the file does not say is None."""

    rows: tuple[DHRow, ...]
    convention: Convention | None = None
    name: str | None = None
    base: Placement | None = None
    tool: Placement | None = None


class _TomlTable(StrictModel):
    """The file as TOML; the rows are checked on their own."""

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
    text = toml_text(path)
    if path.suffix.lower() == ".toml":
        return _parse_toml(text, str(path), units)
    return _parse_csv(text, str(path), units)


def _parse_toml(text: str, source: str, units: Units) -> DHFile:
    rows: list[DHRow] = []

    def row_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
        if raw.get("rows") == []:
            yield Problem("rows", "is empty; a table has a row for each joint")
        for index, values in enumerate(tables_in(raw.get("rows"))):
            columns, wrong_keys = columns_of(values, units)
            row, wrong_values = row_of(values, columns, as_text=False)
            for key, message in wrong_keys + wrong_values:
                yield Problem(f"rows[{index}].{key}", message)
            rows.extend([row] if row else [])

    said = parse_strict(text, source, _TomlTable, row_problems)
    return DHFile(tuple(rows), said.convention, said.name, said.base, said.tool)


def _parse_csv(text: str, source: str, units: Units) -> DHFile:
    try:
        lines = [
            (number, [cell.strip() for cell in next(csv.reader([line]))])
            for number, line in enumerate(text.removeprefix("\ufeff").split("\n"), 1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise FileError(source, [Problem("", f"is not CSV: {error}")]) from error
    if len(lines) < 2:
        what = "holds no table: a header line and then a line for each joint"
        raise FileError(source, [Problem("", what)])
    (number, keys), *body = lines
    columns, wrong = columns_of(keys, units)
    problems = [Problem(f"line {number}, column {k}", why) for k, why in wrong]
    rows: list[DHRow] = []
    for number, cells in body:
        if len(cells) != len(keys):
            what = f"has {len(cells)} cells; the header has {len(keys)}"
            problems.append(Problem(f"line {number}", what))
            continue
        values = dict(zip(keys, cells, strict=True))
        row, wrong = row_of(values, columns, as_text=True)
        problems += [Problem(f"line {number}, column {k}", why) for k, why in wrong]
        rows.extend([row] if row else [])
    if problems:
        raise FileError(source, problems)
    return DHFile(tuple(rows))


def dh_csv(table: DHTable, names: Sequence[str], base_rad: Sequence[float]) -> str:
    """Write a classic table as CSV; base and tool stand in a comment, as options."""
    lines = [
        "# classic; theta_rad where the reading is zero, base_rad the base posture.",
        "# CSV has no place for these, give them to `traverse arm from-dh`:",
        f"#   --convention {table.convention} {_options('base', table.base)} \\",
        f"#   {_options('tool', table.tool)}",
        "name,a_mm,d_mm,alpha_rad,theta_rad,base_rad",
    ]
    for row in _rows(table, names, base_rad):
        lines.append(",".join(str(value) for value in row.values()))  # noqa: PERF401 - reads better than one long expression
    return "\n".join(lines) + "\n"


def dh_values(
    arm: str, table: DHTable, names: Sequence[str], base_rad: Sequence[float]
) -> dict[str, Any]:
    """Give a table as the plain values of its TOML file."""
    return {
        "schema": "traverse/dh/1",
        "convention": table.convention,
        "name": arm,
        "base": _placement(table.base),
        "tool": _placement(table.tool),
        "rows": _rows(table, names, base_rad),
    }


def dh_toml(values: Mapping[str, Any]) -> str:
    """Write the values of a table as TOML, from which the same arm can be made."""
    return arm_text(values)


def _rows(
    table: DHTable, names: Sequence[str], base_rad: Sequence[float]
) -> list[dict[str, Any]]:
    return [
        {
            "name": names[k],
            "a_mm": _mm(table.a_mm[k]),
            "d_mm": _mm(table.d_mm[k]),
            "alpha_rad": _rad(table.alpha_rad[k]),
            "theta_rad": _rad(table.theta_rad[k]),
            "base_rad": float(base_rad[k]),
        }
        for k in range(table.n_joints)
    ]


def _placement(transform: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, Any]:
    return {
        "xyz_mm": [_mm(value) for value in transform[:3, 3]],
        "rpy_rad": [_rad(value) for value in roll_pitch_yaw(transform[:3, :3])],
    }


def _options(which: str, transform: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    placed = _placement(transform)
    xyz, rpy = (",".join(map(str, placed[key])) for key in ("xyz_mm", "rpy_rad"))
    return f"--{which}-xyz-mm={xyz} --{which}-rpy-rad={rpy}"


def _mm(length: float) -> float:
    # The dust of rounding goes; adding zero turns -0.0 into 0.0.
    return round(float(length), 12) + 0.0


def _rad(angle: float) -> float:
    return round(float(angle), 15) + 0.0
