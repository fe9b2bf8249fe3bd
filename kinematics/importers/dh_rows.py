"""Rows of a Denavit-Hartenberg table from what a file has under its keys.

A key carries its unit (`a_mm`, `alpha_deg`); one without takes the unit given on the
command line and is refused if there is none. What is wrong comes back as pairs of the
key and a message; who reads the file knows the place.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from traverse.strict_toml.problems import shown, unknown_name_message
from traverse.strict_toml.raw_values import number_in

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
_PLAIN = ("name", "counts_per_turn", "sign", "source")
_KNOWN = [
    *_PLAIN,
    *(f"{q}_{unit}" for q, units in _QUANTITIES.items() for unit in units),
]
_INTEGERS = {"counts_per_turn": "an integer from 1 to 2^32", "sign": "1 or -1"}
_PI = re.compile(r"([+-]?)(\d+(?:\.\d*)?)? ?\*? ?pi(?: ?/ ?(\d+(?:\.\d*)?))?")

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
    """One joint of a table; `base_rad` is its reading in the base posture."""

    a_mm: float
    d_mm: float
    alpha_rad: float
    theta_rad: float = 0.0
    base_rad: float = 0.0
    name: str | None = None
    counts_per_turn: int | None = None
    sign: int | None = None
    source: str | None = None


@dataclass(frozen=True, slots=True)
class Column:
    """What a key holds: a field of `DHRow` in units of `factor`; 0 for a plain one."""

    field: str
    factor: float


def columns_of(keys: Iterable[str], units: Units) -> tuple[dict[str, Column], Wrong]:
    """Say what each key of a row, or of a header, holds."""
    columns: dict[str, Column] = {}
    wrong: Wrong = []
    taken: dict[str, str] = {}
    for key in keys:
        column = _column(key, units)
        if isinstance(column, str):
            wrong.append((key, column))
        elif column.field in taken:
            wrong.append((key, f"says again what '{taken[column.field]}' says"))
        else:
            columns[key] = column
        # A key that cannot be used is not missing too.
        taken.setdefault(
            column.field if isinstance(column, Column) else _stem(key), key
        )
    for quantity in _REQUIRED:
        field = f"{quantity}_{next(iter(_QUANTITIES[quantity]))}"
        if field not in taken and quantity not in taken:
            wrong.append((field, "is missing; add it"))
    return columns, wrong


def row_of(
    values: Mapping[str, object], columns: Mapping[str, Column], *, as_text: bool
) -> tuple[DHRow | None, Wrong]:
    """Take one row.

    Args:
        values: What stands under each key; text that is empty counts as absent.
        columns: What the keys hold; other keys are passed over.
        as_text: Numbers are still text, as in CSV.

    Returns:
        The row, nothing if anything is wrong; and all that is.
    """
    fields: dict[str, object] = {}
    wrong: Wrong = []
    for key, column in columns.items():
        value = values.get(key, "" if as_text else None)
        if value == "" and as_text:
            if column.field.partition("_")[0] in _REQUIRED:
                wrong.append((key, "is empty; give a number"))
            continue
        found = _field_value(column, value, as_text=as_text)
        if isinstance(found, _Refused):
            wrong.append((key, found.why))
        else:
            fields[column.field] = found
    if wrong or any(f not in fields for f in ("a_mm", "d_mm", "alpha_rad")):
        return None, wrong
    return DHRow(**fields), wrong  # type: ignore[arg-type]  # checked field by field


@dataclass(frozen=True, slots=True)
class _Refused:
    why: str


def _stem(key: str) -> str:
    return key.partition("_")[0]


def _column(key: str, units: Units) -> Column | str:
    """What a key holds, or what is wrong with it."""
    if key in _PLAIN:
        return Column(key, 0.0)
    quantity, _, unit = key.partition("_")
    factors = _QUANTITIES.get(quantity)
    if factors is not None and not unit:
        option, given = (
            ("--lengths", units.lengths)
            if factors is _LENGTHS
            else ("--angles", units.angles)
        )
        if given is None:
            named = " or ".join(f"'{quantity}_{known}'" for known in factors)
            either = " or ".join(factors)
            return f"has no unit; name it {named}, or give {option} {either}"
        unit = given
    if factors is None or unit not in factors:
        return unknown_name_message("key", key, _KNOWN)
    return Column(f"{quantity}_{next(iter(factors))}", factors[unit])


def _field_value(
    column: Column, value: object, *, as_text: bool
) -> float | int | str | _Refused:
    if column.field in _INTEGERS:
        number = _integer(value) if as_text else value
        good = (1, -1) if column.field == "sign" else range(1, 2**32 + 1)
        if (
            isinstance(number, bool)
            or not isinstance(number, int)
            or number not in good
        ):
            return _Refused(f"{shown(value)} is not {_INTEGERS[column.field]}")
        return number
    if column.factor == 0.0:
        if not isinstance(value, str):
            return _Refused(f"{shown(value)} is not a string; put it in quotes")
        return value
    quantity = _number(value, as_text=as_text)
    is_angle = column.field.endswith("_rad")
    if quantity is None and column.factor == 1.0 and is_angle:
        quantity = _part_of_pi(value)
    if quantity is not None and abs(quantity * column.factor) <= _LARGEST:
        return quantity * column.factor
    why = f"{shown(value)} is not a finite number"
    if quantity is not None:
        why = f"{shown(value)} is beyond any arm; mind the unit"
    elif is_angle:
        in_rad = column.factor == 1.0
        why += " or a part of pi such as -pi/2" if in_rad else " of degrees"
    return _Refused(why)


def _integer(value: object) -> int | None:
    text = str(value)
    return int(text) if re.fullmatch(r"[+-]?\d{1,12}", text, re.ASCII) else None


def _number(value: object, *, as_text: bool) -> float | None:
    if not as_text:
        return number_in(value)
    try:
        return number_in(float(str(value)))
    except ValueError:
        return None


def _part_of_pi(value: object) -> float | None:
    found = _PI.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return None
    sign, factor, divisor = found.groups()
    below = float(divisor or 1.0)
    part = float(factor or 1.0) * math.pi
    return None if below == 0.0 else (-part if sign == "-" else part) / below
