"""The one reader of tables: a header, numbered rows, and all that is wrong with them.

A reader of some kind of table asks for the columns that it knows and says what a cell
must be; everything about the text, and how it is refused, is here. Nothing is
half-read: `check` refuses the file where anything was wrong.
"""

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.plurals import counted
from traverse.strict_toml.problems import FileError, Problem, shown
from traverse.tables.dialect import (
    SEPARATORS,
    Dialect,
    lines_of,
    named_separator,
    separator_of,
)
from traverse.tables.numbers import MixedMarksError, NumberReader, Unit, unit_of

# More problems than anybody reads; the rest is counted.
_MOST_SHOWN = 100
# As many are kept, of which the first in the file are shown.
_MOST_KEPT = 20_000

_NO_TABLE = "holds no table: a header line and then a line for each row"

Lines = Iterator[tuple[int, str]]


class Table:
    """A table that is being read.

    Attributes:
        dialect: How its cells are written.
    """

    def __init__(
        self, path: Path, header: tuple[str, ...], dialect: Dialect, lines: Lines
    ) -> None:
        self.header = header
        self.dialect = dialect
        self._path = path
        self._lines = lines
        self._numbers = NumberReader(dialect.separator)
        self._problems: list[tuple[int, Problem]] = []
        self._n_problems = 0
        self._surplus_line: int | None = None  # the first with a doubtful last cell

    def refuse(self, line: int, message: str, column: str | None = None) -> None:
        """Note a fault of a line, or of the cell of a column in it.

        Args:
            line: Number of the line; 0 for the whole file.
            message: The read value, the expectation, the remedy.
            column: Its name.
        """
        self._n_problems += 1
        if len(self._problems) < _MOST_KEPT:
            where = f"line {line}" if line else ""
            where += f", column {column}" if column else ""
            self._problems.append((line, Problem(where, message)))

    def refuse_header(self, message: str, column: str | None = None) -> None:
        self.refuse(self.dialect.header_line, message, column)

    def check(self) -> None:
        """Refuse the file if anything is wrong; called when all rows are read.

        Raises:
            FileError: With everything that is wrong.
        """
        if doubt := self._numbers.doubt():
            self.refuse(*doubt)
        if self._surplus_line is not None and not self._numbers.has_points:
            self.refuse(
                self._surplus_line,
                f"ends with an empty cell beyond the {len(self.header)} columns of the "
                "header: a separator too many, or a decimal comma that cut a number; "
                "end the header with it too, or write decimal points",
            )
        if self._problems:
            ordered = sorted(self._problems, key=lambda numbered: numbered[0])
            problems = [problem for _, problem in ordered[:_MOST_SHOWN]]
            if n_unshown := self._n_problems - len(problems):
                problems.append(
                    Problem("", f"and {n_unshown} more problems like these")
                )
            raise FileError(self._path, problems)

    def rows(self, filled: Collection[str] = ()) -> Iterator[tuple[int, list[str]]]:
        """Yield the number of the line and the cells of every row, without blanks.

        A line with another number of cells than the header is refused and left out.

        Args:
            filled: Columns that are never empty; a table whose last column is one may
                end its lines with separators that its header lacks.
        """
        width, dialect = len(self.header), self.dialect
        is_sure = dialect.separator != "," or self.header[-1] in filled
        for line, cells in _split(self._path, self._lines, dialect, width):
            if len(cells) > width and not any(cells[width:]):
                surplus = len(cells) - width > dialect.trailing
                if surplus and not is_sure and self._surplus_line is None:
                    self._surplus_line = line
                del cells[width:]
            if len(cells) == width:
                yield line, cells
            else:
                self.refuse(line, self._wrong_width(len(cells)))

    def rows_by_name(
        self, filled: Collection[str] = ()
    ) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield the rows as cells by the names of their columns; see `rows`."""
        for line, cells in self.rows(filled):
            yield line, dict(zip(self.header, cells, strict=True))

    def number(
        self, line: int, column: str, cell: str, unit: Unit | None = None
    ) -> float | None:
        """Read a cell as a number; None, and a refusal, for other texts.

        Args:
            line: Of the cell.
            column: Its name.
            cell: Its text.
            unit: Of an angle; by default as the column's name says.

        Raises:
            FileError: The table has decimal commas and decimal points.
        """
        try:
            return self._numbers.number(cell, unit or unit_of(column), line)
        except MixedMarksError as error:
            raise FileError(self._path, str(error)) from error
        except ValueError as error:
            self.refuse(line, str(error), column)
            return None

    def vector(
        self, line: int, row: Mapping[str, str], columns: Sequence[str]
    ) -> Floats | None:
        """Read some cells of a row, (n,); None where all are empty or one is wrong.

        Raises:
            FileError: The table has decimal commas and decimal points.
        """
        cells = [row.get(column, "") for column in columns]
        if not any(cells):
            return None
        pairs = zip(columns, cells, strict=True)
        numbers = [self.number(line, column, cell) for column, cell in pairs]
        known = [number for number in numbers if number is not None]
        return np.array(known) if len(known) == len(numbers) else None

    def integer(self, line: int, cell: str) -> int | None:
        """Read a cell as an integer; None for other texts.

        Raises:
            FileError: The table has decimal commas and decimal points.
        """
        try:
            return self._numbers.integer(cell, line)
        except MixedMarksError as error:
            raise FileError(self._path, str(error)) from error

    def numbers(
        self, lines: Sequence[int], column: str, cells: Sequence[str]
    ) -> tuple[Floats, dict[int, str]]:
        """Read many cells of a column as numbers, fast where they are plain.

        Args:
            lines: Of each cell.
            column: Its name.
            cells: n of them; an empty one is NaN.

        Returns:
            Numbers, (n,), and by the index of a cell its fault.

        Raises:
            FileError: The table has decimal commas and decimal points.
        """
        try:
            return self._numbers.column(cells, unit_of(column), lines)
        except MixedMarksError as error:
            raise FileError(self._path, str(error)) from error

    def _wrong_width(self, n_cells: int) -> str:
        width, separator = len(self.header), self.dialect.separator
        message = f"has {counted(n_cells, 'cell')}; the header has {width}"
        if n_cells > width and separator == ",":
            return f"{message}; decimal commas need ';' or tabs between the columns"
        return f"{message}, with {SEPARATORS[separator]} between them"


@contextmanager
def open_table(path: Path, *, has_header: bool = True) -> Iterator[Table]:
    """Open a table and read its header.

    Args:
        path: The file.
        has_header: Else the first line is a row, and the columns are called
            "column 1", "column 2" ...

    Raises:
        FileError: It cannot be read, is no text, or has no header; also while its rows
            are read.
    """
    with lines_of(path) as lines:
        yield _begun(path, lines, has_header=has_header)


def _begun(path: Path, lines: Lines, *, has_header: bool) -> Table:
    mark, separator = None, ","
    for number, line in lines:
        try:
            if number == 1 and (mark := named_separator(line)):
                continue
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            separator = mark or separator_of(line)
            in_line = [name for sign, name in SEPARATORS.items() if sign in line]
            if mark and in_line and mark not in line:
                raise ValueError(
                    f"has {' and '.join(in_line)}, but line 1 names another"
                )
        except ValueError as error:
            raise FileError(path, [Problem(f"line {number}", str(error))]) from error
        break
    else:
        raise FileError(path, _NO_TABLE)
    dialect = Dialect(separator, trailing=0, header_line=number)
    _, names = next(_split(path, iter([(number, line)]), dialect, 0), (0, []))
    width = max((column for column, name in enumerate(names, 1) if name), default=0)
    if not width:
        raise FileError(path, _NO_TABLE)
    header = tuple(names[:width])
    if not has_header:
        header = tuple(f"column {n}" for n in range(1, width + 1))
        lines = chain([(number, line)], lines)
    table = Table(path, header, replace(dialect, trailing=len(names) - width), lines)
    for name in dict.fromkeys(name for name in header if header.count(name) > 1):
        table.refuse_header(f"column {shown(name)} stands there twice")
    return table


def _split(
    path: Path, lines: Lines, dialect: Dialect, width: int
) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of every line that holds any."""
    number, mark, has_blanks = 0, dialect.separator, False
    blanks = " " if mark == "\t" else " \t"

    def texts() -> Iterator[str]:
        nonlocal number, has_blanks
        for number, line in lines:
            bare = line.lstrip()
            has_blanks = not line.isascii() or any(blank in line for blank in blanks)
            if not bare.startswith("#"):
                yield line
            elif bare[1:2].strip() and bare.count(mark) + 1 == width > 1:
                problem = (
                    f"begins with {shown(bare.split(mark)[0])}: a comment, or a row? "
                    "put a blank behind '#', or the cell into quotes"
                )
                raise FileError(path, [Problem(f"line {number}", problem)])

    reader = csv.reader(texts(), delimiter=mark, skipinitialspace=True, strict=True)
    while True:
        before = reader.line_num
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            problem = Problem(f"line {number}", _not_csv(error))
            raise FileError(path, [problem]) from error
        if reader.line_num > before + 1:
            message = "has a cell in quotes that goes on over the end of a line"
            raise FileError(path, [Problem(f"line {number}", f"{message}; close it")])
        if has_blanks:
            cells = [cell.strip() for cell in cells]
        if any(cells):
            yield number, cells


def _not_csv(error: csv.Error) -> str:
    if "end of data" in str(error):
        return "ends within a cell in quotes; close it"
    return f"is not CSV: {error}; put a whole cell into quotes, and double those inside"
