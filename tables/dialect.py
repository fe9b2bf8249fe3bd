"""How a table is written: bytes to lines, and the mark between its columns.

The detection, in this order; remaining doubts are refused:

1. Encoding: by a byte order mark (UTF-8, UTF-16, UTF-32), UTF-16 without one by the
   zero byte in the first character, else UTF-8.
2. Line ends: LF, CR LF or CR.
3. `sep=;` as the first line (Excel) names the mark between columns.
4. A line that begins with `#` is a comment, empty lines and rows of empty cells hold
   nothing. `#name,...` without a blank behind `#` and with as many cells as the header
   may be a row, and is refused. `"#1"` in quotes is a cell.
5. The mark between columns is the only one of `,` `;` tab that the header has outside
   of quotes.
"""

import codecs
import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from traverse.strict_toml.files import MOST_LINE, open_regular
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    character_name,
    shown,
    system_reason,
)

SUFFIXES = (".csv", ".txt", ".tsv")
SEPARATORS = {",": "','", ";": "';'", "\t": "tab"}
_OTHER_SEPARATORS = {"|": "'|'", " ": "blanks", "\xa0": "blanks"}
_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_OTHER_FILES = (
    (
        b"PK\x03\x04",
        "an Excel workbook or another archive; save its sheet as CSV UTF-8",
    ),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook; save its sheet as CSV UTF-8"),
    (b"PAR1", "a Parquet file; write it as CSV"),
    (b"\x89MCAP", "an MCAP file; end its name with .mcap"),
    (b"\x1f\x8b", "compressed by gzip; expand it"),
)
_QUOTE = '"'


@dataclass(frozen=True, slots=True)
class Dialect:
    """How the cells of a table are written.

    Attributes:
        separator: Between columns: `,`, `;` or tab.
        trailing: How many separators more the header ends with.
        header_line: Number of the header's line, from 1 on.
    """

    separator: str
    trailing: int
    header_line: int


@contextmanager
def lines_of(path: Path) -> Iterator[Iterator[tuple[int, str]]]:
    """Open a file of text and yield its numbered lines, each with its end.

    Raises:
        FileError: It cannot be read, is another kind of file, or has a line longer than
            `MOST_LINE` characters; also while it is read.
    """
    try:
        with open_regular(path) as file:
            encoding = _encoding(path, file.peek(8)[:8])  # type: ignore[attr-defined]
            with io.TextIOWrapper(file, encoding=encoding, newline="") as text:
                yield _numbered(path, text)
    except OSError as error:
        raise FileError(path, f"cannot be read: {system_reason(error)}") from error
    except UnicodeError as error:
        raise FileError(path, [_undecodable(path, error)]) from error


def _encoding(path: Path, head: bytes) -> str:
    for magic, kind in _OTHER_FILES:
        if head.startswith(magic):
            raise FileError(path, f"is {kind}")
    for mark, encoding in _BYTE_ORDER_MARKS:
        if head.startswith(mark):
            return encoding
    if len(head) > 1 and (head[0] == 0) != (head[1] == 0):
        return "utf-16-be" if head[0] == 0 else "utf-16-le"
    return "utf-8"


def _numbered(path: Path, text: TextIO) -> Iterator[tuple[int, str]]:
    number = 0
    while line := text.readline(MOST_LINE + 1):
        number += 1
        if len(line) > MOST_LINE:
            message = f"has more than {MOST_LINE} characters; expected a row of a table"
            raise FileError(path, [Problem(f"line {number}", message)])
        yield number, line


def _undecodable(path: Path, error: UnicodeError) -> Problem:
    """Name the invalid place of a file in UTF-8; a decoder knows its own piece only."""
    remedy = "save the file as UTF-8"
    encoding = getattr(error, "encoding", "utf-16")
    if encoding.startswith("utf-8"):
        with open_regular(path) as file:
            for number, line in enumerate(
                iter(lambda: file.readline(MOST_LINE), b""), 1
            ):
                try:
                    line.decode("utf-8")
                except UnicodeDecodeError as refusal:
                    byte = line[refusal.start : refusal.start + 1]
                    character = byte.decode("cp1252", "ignore")
                    as_windows = (
                        f" (in Windows-1252 {character_name(character)})"
                        if character
                        else ""
                    )
                    where = f"line {number}, column {refusal.start + 1}"
                    problem = f"byte 0x{byte[0]:02x}{as_windows} is not UTF-8; {remedy}"
                    return Problem(where, problem)
    return Problem("", f"begins like {encoding.upper()} but is not; {remedy}")


def separator_of(line: str) -> str:
    """Return the mark between the columns of a header, `,` where there is one column.

    Raises:
        ValueError: It has several of them, or another one.
    """
    bare = "".join(line.split(_QUOTE)[::2])
    marks = [mark for mark in SEPARATORS if mark in bare]
    if len(marks) > 1:
        names = " and ".join(SEPARATORS[mark] for mark in marks)
        raise ValueError(f"has {names} between its columns; use one of them throughout")
    if marks:
        return marks[0]
    for mark, name in _OTHER_SEPARATORS.items():
        if mark in bare.strip():
            raise ValueError(
                f"{shown(line.strip())} has {name} between its columns; expected ',', "
                "';' or tab"
            )
    return ","


def named_separator(line: str) -> str | None:
    """Return the mark that a line such as `sep=;` names; None for any other line.

    Raises:
        ValueError: It names another one than `,`, `;` or tab.
    """
    text = line.rstrip("\r\n").strip(_QUOTE)
    if not text.lower().startswith("sep="):
        return None
    mark = text[4:].rstrip(_QUOTE) or ","
    mark = "\t" if mark == "\\t" else mark
    if mark not in SEPARATORS:
        raise ValueError(f"{shown(text)} is not valid here; expected sep=, ; or tab")
    return mark
