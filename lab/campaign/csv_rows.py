"""Rows of CSV files as programs in any language write them.

Cells are separated by commas, semicolons or tabs, whichever the header has; no name of
a column contains any of them. Between semicolons or tabs numbers may have decimal
commas, if all of the file have.
"""

import csv
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

from traverse.strict_toml.files import table_lines
from traverse.strict_toml.problems import FileError, Problem

Rows = Callable[[Collection[int]], Iterator[list[str]]]
_SEPARATORS = {",": "','", ";": "';'", "\t": "tab"}


def _separator(header: str) -> str:
    marks = [mark for mark in _SEPARATORS if mark in header]
    if len(marks) > 1:
        names = " and ".join(_SEPARATORS[mark] for mark in marks)
        raise ValueError(f"has {names} between its columns; use one of them throughout")
    return marks[0] if marks else ","


@contextmanager
def csv_rows(path: Path, key: str) -> Iterator[tuple[list[str], Rows]]:
    """Open a table.

    Args:
        path: The CSV file, in UTF-8.
        key: What names it in `campaign.toml`, for errors.

    Yields:
        The names of the header, and a function that returns the rows below it, called
        with the indices of the columns that hold numbers.

    Raises:
        FileError: It cannot be read; also for what happens while its rows are read.
    """
    try:
        with table_lines(path) as file:
            line = next(file, "")
            try:
                mark = _separator(line)
            except ValueError as error:
                raise FileError(path, [Problem("line 1", str(error))]) from error
            reader = csv.reader(chain([line], file), delimiter=mark)
            header = [name.strip() for name in next(reader, [])]

            def rows(columns: Collection[int]) -> Iterator[list[str]]:
                if mark == ",":
                    return reader
                return _with_decimal_points(path, reader, columns)

            yield header, rows
    except OSError as error:
        reason = error.strerror or str(error)
        message = f"cannot be read: {reason}; check `{key}`"
        raise FileError(path, message) from error
    except (UnicodeDecodeError, csv.Error) as error:
        message = f"is not CSV in UTF-8: {error}"
        raise FileError(path, message) from error


def _with_decimal_points(
    path: Path, rows: Iterator[list[str]], columns: Collection[int]
) -> Iterator[list[str]]:
    """Write decimal commas as points.

    Args:
        path: For errors.
        rows: Below the header.
        columns: Indices of those that hold numbers.

    Raises:
        FileError: Some numbers have a comma and others a point: one of them might
            separate thousands.
    """
    first: dict[str, str] = {}
    for line, cells in enumerate(rows, 2):
        for index in columns:
            if index < len(cells):
                for mark in ",.":
                    if mark in cells[index]:
                        first.setdefault(mark, f"{cells[index]!r} in line {line}")
                cells[index] = cells[index].replace(",", ".")
        if len(first) > 1:
            message = (
                f"has decimal commas ({first[',']}) and decimal points ({first['.']}); "
                "write all numbers with one of them, and none between thousands"
            )
            raise FileError(path, message)
        yield cells
