"""Numbers as people and spreadsheets write them.

Read without doubt: a decimal point; a decimal comma, throughout a table with `;` or tab
between its columns; a minus as typeset (U+2212, en dash, hyphens); a degree sign in a
column of degrees; parts of pi in a column of radians; thousands set apart by an
apostrophe or an unbreakable blank, or by a comma or point where the decimal mark or a
second one beside it says so. A point by itself is always the decimal one.

Refused: decimal commas and points in one table; `1,234` where it may be a thousand
(no other number of the table shows what the comma is, and the columns are not
separated by `;`, as they are only where the comma is the decimal mark).
"""

import math
import re
from collections.abc import Sequence
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.strict_toml.problems import LARGEST, odd_characters, shown

Unit = Literal["rad", "deg", "other"]

# U+2212 minus, en dash, hyphen, non-breaking hyphen, small and full-width hyphen-minus.
_MINUS = dict.fromkeys(map(ord, "\u2212\u2013\u2010\u2011\ufe63\uff0d"), "-")
_DEGREE = ("\u00b0", "\u00ba")
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_COMMA = re.compile(r"([+-]?)(\d*),(\d+)((?:[eE][+-]?\d+)?)", re.ASCII)
_MAYBE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_GROUPED = re.compile(
    r"(?P<whole>[+-]?[1-9]\d{0,2}(?:(?P<mark>[,.'\u2019\u00a0\u202f\u2009])\d{3})"
    r"(?:(?P=mark)\d{3})*)(?:(?P<decimal>[,.])(?P<part>\d+))?",
    re.ASCII,
)
_PI = re.compile(
    r"([+-]?)(\d+(?:\.\d*)?|\.\d+)? ?\*? ?(?:pi|\u03c0)(?: ?/ ?(\d+(?:\.\d*)?))?",
    re.ASCII | re.IGNORECASE,
)
_FAST = frozenset("0123456789+-eE.,\n")
_REMEDY = "write it like -1234.5, without unit"


def unit_of(column: str) -> Unit:
    """Return the unit of a column's angles, by its name."""
    if column.endswith("_rad"):
        return "rad"
    return "deg" if column.endswith("_deg") else "other"


def part_of_pi(text: str) -> float | None:
    """Read `pi`, `-pi/2`, `0.5*pi` or `3\u03c0/4`; None for anything else."""
    match = _PI.fullmatch(text.translate(_MINUS))
    if match is None:
        return None
    sign, factor, divisor = match.groups()
    below = float(divisor or 1.0)
    part = float(factor or 1.0) * math.pi
    return None if below == 0.0 else (-part if sign == "-" else part) / below


class MixedMarksError(ValueError):
    """Numbers of a table have decimal commas and decimal points."""


class NumberReader:
    """Reads the numbers of one table, which have one decimal mark.

    Args:
        separator: Between the columns of the table.
    """

    def __init__(self, separator: str) -> None:
        self._separator = separator
        self._first: dict[str, str] = {}  # decimal mark -> number that shows it, where
        self._doubtful: tuple[int, str] | None = None
        self._sure_of_comma = separator == ";"

    @property
    def has_points(self) -> bool:
        """Whether a number with a decimal point was read."""
        return "." in self._first

    def doubt(self) -> tuple[int, str] | None:
        """Return the line and the message of a number that stayed doubtful."""
        if self._doubtful is None or self._sure_of_comma:
            return None
        line, text = self._doubtful
        decimal, thousands = text.replace(",", "."), text.replace(",", "")
        return line, (
            f"{shown(text)} may be {decimal} or {thousands}: no other "
            "number shows whether U+002C COMMA is the decimal mark; write a decimal "
            "point and nothing between thousands, or ';' between columns"
        )

    def number(self, text: str, unit: Unit, line: int) -> float:
        """Read one cell.

        Raises:
            ValueError: It is not a finite number; names its characters.
            MixedMarksError: Its decimal mark differs from the numbers before it.
        """
        bare = text.strip()
        if not _PLAIN.fullmatch(bare):
            bare = bare.translate(_MINUS)
            if unit == "deg" and bare.endswith(_DEGREE):
                bare = bare[:-1].rstrip()
            if unit == "rad" and (angle_rad := part_of_pi(bare)) is not None:
                return angle_rad
            bare = self._with_point(bare, text, unit, line)
        elif "." in bare:
            self._show(".", text, line)
        value = float(bare)
        if not abs(value) <= LARGEST:
            raise ValueError(f"{shown(text)} is not a finite number below {LARGEST:g}")
        return value

    def integer(self, text: str, line: int) -> int | None:
        """Read one cell as an integer of at most 19 digits; None if it is not one."""
        bare = text.strip().translate(_MINUS)
        grouped = _GROUPED.fullmatch(bare)
        if grouped and not grouped["decimal"] and _is_clear(grouped):
            bare = self._ungrouped(grouped, text, line)
        return int(bare) if re.fullmatch(r"[+-]?\d{1,19}", bare, re.ASCII) else None

    def column(
        self, cells: Sequence[str], unit: Unit, lines: Sequence[int]
    ) -> tuple[Floats, dict[int, str]]:
        """Read the cells of a column, fast where they are plain.

        Args:
            cells: n of them; an empty one is NaN.
            unit: Of the column.
            lines: Of each cell.

        Returns:
            Numbers, (n,), and by the index of a cell its fault; it is NaN.

        Raises:
            MixedMarksError: See `number`.
        """
        characters = set("\n".join(cells))
        mark = "," if "," in characters else "."
        foreign_mark = "." if mark == "," else ","
        is_plain = characters <= _FAST and foreign_mark not in characters
        if (
            is_plain
            and foreign_mark not in self._first
            and (mark == "." or self._separator == ";")
        ):
            values = _plain_values(cells)
            if values is not None:
                if mark in characters and mark not in self._first:
                    row = next(row for row, cell in enumerate(cells) if mark in cell)
                    self._show(mark, cells[row], lines[row])
                return values, {}
        values = np.full(len(cells), np.nan)
        wrong: dict[int, str] = {}
        for row, cell in enumerate(cells):
            try:
                values[row] = self.number(cell, unit, lines[row]) if cell else np.nan
            except MixedMarksError:  # of the whole table
                raise
            except ValueError as error:
                wrong[row] = str(error)
        return values, wrong

    def _with_point(self, bare: str, text: str, unit: Unit, line: int) -> str:
        """Write a number with the decimal point and without thousands."""
        if _PLAIN.fullmatch(bare):
            if "." in bare:
                self._show(".", text, line)
            return bare
        grouped = _GROUPED.fullmatch(bare)
        if grouped and _is_clear(grouped):
            return self._ungrouped(grouped, text, line)
        if comma := _COMMA.fullmatch(bare):
            if _MAYBE_THOUSANDS.fullmatch(bare):
                self._doubtful = self._doubtful or (line, text.strip())
            else:
                self._sure_of_comma = True
            self._show(",", text, line)
            sign, integer, part, exponent = comma.groups()
            return f"{sign}{integer}.{part}{exponent}"
        raise ValueError(_what_is_wrong(text, unit))

    def _ungrouped(self, grouped: re.Match[str], text: str, line: int) -> str:
        mark, decimal = grouped["mark"], grouped["decimal"]
        if decimal or mark in ",.":
            shown_decimal = decimal or (",.".replace(mark, ""))
            self._sure_of_comma |= shown_decimal == ","
            self._show(shown_decimal, text, line)
        integer = grouped["whole"].replace(mark, "")
        return f"{integer}.{grouped['part']}" if decimal else integer

    def _show(self, mark: str, text: str, line: int) -> None:
        self._first.setdefault(mark, f"{text.strip()!r} in line {line}")
        if len(self._first) > 1:
            raise MixedMarksError(
                f"has decimal commas ({self._first[',']}) and decimal points "
                f"({self._first['.']}); write all numbers with one of them, and none "
                "between thousands"
            )


def _plain_values(cells: Sequence[str]) -> Floats | None:
    """Convert plain cells, (n,), the empty ones to NaN; None where one is no number."""
    try:
        values = np.array(
            [cell.replace(",", ".") or "nan" for cell in cells], np.float64
        )
    except ValueError:
        return None
    is_good = np.abs(values) <= LARGEST
    if not is_good.all() and any(
        cells[row] for row in np.flatnonzero(~is_good).tolist()
    ):
        return None
    return values


def _is_clear(grouped: re.Match[str]) -> bool:
    """Whether three digits apart are thousands: 1'234, 1.234,5 or 1,234,567."""
    mark, decimal = grouped["mark"], grouped["decimal"]
    if decimal == mark:
        return False
    return mark not in ",." or bool(decimal) or grouped["whole"].count(mark) > 1


def _what_is_wrong(text: str, unit: Unit) -> str:
    problem = f"{shown(text)} is not a finite number"
    if unit == "rad":
        problem += " or a part of pi such as -pi/2"
    if unit == "deg":
        problem += " of degrees"
    if unit != "deg" and text.rstrip().endswith(_DEGREE):
        expected = "radians" if unit == "rad" else "no angle"
        problem += f": expected {expected}"
    elif unit != "rad" and part_of_pi(text.strip()) is not None:
        problem += ": parts of pi are radians"
    if odd := odd_characters(text):
        problem += f"; it has {odd}"
    elif " " in text.strip():
        problem += "; it has U+0020 SPACE inside"
    return f"{problem}; {_REMEDY}"
