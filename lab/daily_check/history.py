"""The history of daily checks: one SQLite file, one row a check.

Only this is written: what is drawn and judged is computed anew from it each time.
"""

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from types import NoneType
from typing import get_args

from traverse.lab.daily_check.figures import DailyCheckFigures
from traverse.protocol.printable import printable
from traverse.strict_toml.files import text_of
from traverse.strict_toml.ownership import refused_owner
from traverse.strict_toml.problems import shown

VERSION = 2
APPLICATION = 0x54525649  # "TRVI"
_TABLE = text_of(Path(__file__).with_name("history.sql"))


class HistoryRefusedError(Exception):
    """The file is none that this version may use; says what to do."""


@dataclass(frozen=True, slots=True)
class Check:
    """One daily check.

    Attributes:
        time_utc: ISO 8601, to the second, with Z.
        data_digest: Of the poses, so that none counts twice.
        begins: Why a new base begins with this check; empty where none does.
    """

    time_utc: str
    arm: str
    arm_digest: str
    data_digest: str
    begins: str
    figures: DailyCheckFigures


_OWN = [field.name for field in fields(Check)][:-1]
_COLUMNS = [*_OWN, *(field.name for field in fields(DailyCheckFigures))]


# Locked, read-only, a full disk and so on: the file is whole.
_OF_THE_SYSTEM = (
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_CANTOPEN,
)


def _told(error: Exception) -> str:
    """Return the reason; that of a damaged file may itself be no text."""
    damaged = isinstance(error, UnicodeDecodeError)
    return "its content is no text" if damaged else printable(str(error))


_MAY_BE_NONE = {
    field.name
    for field in fields(DailyCheckFigures)
    if NoneType in get_args(field.type)
}


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    if path.exists() and not path.is_file():
        raise HistoryRefusedError(
            f"{path}: is not a file; expected the SQLite file of a history, or the "
            "name of a new one"
        )
    try:
        connected = sqlite3.connect(path, isolation_level=None)
    except sqlite3.OperationalError as error:
        remedy = refused_owner(path) or "name another file"
        raise HistoryRefusedError(f"{path}: {error}; {remedy}") from error
    with contextlib.closing(connected) as connection:
        execute = connection.execute
        try:
            (version,) = execute("PRAGMA user_version").fetchone()
            (application,) = execute("PRAGMA application_id").fetchone()
            (tables,) = execute("SELECT count(*) FROM sqlite_master").fetchone()
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise HistoryRefusedError(
                f"{path}: is no history of checks ({_told(error)}); name another file"
            ) from error
        if (version, application, tables) == (0, 0, 0):
            execute("BEGIN IMMEDIATE")
            execute(_TABLE)
            execute(f"PRAGMA application_id = {APPLICATION}")
            execute(f"PRAGMA user_version = {VERSION}")
            execute("COMMIT")
        elif application != APPLICATION:
            raise HistoryRefusedError(
                f"{path}: is a database of another program; name another file"
            )
        elif version != VERSION:
            raise HistoryRefusedError(
                f"{path}: has a table of version {version}, this program knows "
                f"{VERSION}; use the version of traverse that wrote it"
            )
        try:
            execute("PRAGMA synchronous = FULL")
            (verdict,) = execute("PRAGMA quick_check(1)").fetchone()
            if verdict != "ok":
                raise sqlite3.DatabaseError(verdict)
            yield connection
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            if getattr(error, "sqlite_errorcode", None) in _OF_THE_SYSTEM:
                raise
            raise HistoryRefusedError(
                f"{path}: is damaged ({_told(error)}); take its last copy, or begin a "
                "new history"
            ) from error


def add_check(path: Path, check: Check) -> bool:
    """Keep a check, on the disk; False where its data has been counted before.

    Raises:
        HistoryRefusedError: The file is not a history, or of another version.
        sqlite3.Error: It cannot be written.
    """
    *columns, figures = astuple(check)
    values = [*columns, *figures]
    marks = ", ".join("?" * len(values))
    with _opened(path) as connection:
        done = connection.execute(
            f"INSERT OR IGNORE INTO checks ({', '.join(_COLUMNS)}) VALUES ({marks})",
            values,
        )
        return done.rowcount == 1


def arms_of(path: Path) -> list[str]:
    """Names of the arms with checks in a history.

    Raises:
        HistoryRefusedError: The file is not a history, or of another version.
        sqlite3.Error: It cannot be read.
    """
    with _opened(path) as connection:
        rows = connection.execute("SELECT DISTINCT arm FROM checks ORDER BY arm")
        return [arm for (arm,) in rows]


def checks_of(path: Path, arm: str) -> list[Check]:
    """All checks of an arm, in the order in which they were made.

    Raises:
        HistoryRefusedError: The file is not a history, or of another version.
        sqlite3.Error: It cannot be read.
    """
    with _opened(path) as connection:
        rows = connection.execute(
            f"SELECT {', '.join(_COLUMNS)} FROM checks WHERE arm = ? "
            "ORDER BY time_utc, number",
            (arm,),
        ).fetchall()
        for number, row in enumerate(rows, 1):
            _check_types(row, number)
    n = len(_OWN)
    return [Check(*(*row[:n], DailyCheckFigures(*row[n:]))) for row in rows]


def _check_types(row: Sequence[object], number: int) -> None:
    """Refuse a row with values of other types than were written.

    Raises:
        sqlite3.DatabaseError: It has one.
    """
    for column, value in zip(_COLUMNS, row, strict=True):
        is_text = column in _OWN
        may_be = column in _MAY_BE_NONE and value is None
        good = isinstance(value, str) if is_text else isinstance(value, int | float)
        if not good and not may_be:
            problem = f"check {number}: {column} is {shown(value)}"
            raise sqlite3.DatabaseError(problem)


def judged_with(checks: list[Check], check: Check | None) -> list[Check]:
    """List those up to a check, which is the one to be judged; None: all.

    It may have been computed after later ones.
    """
    digests = [entry.data_digest for entry in checks]
    if check is None or check.data_digest not in digests:
        return checks
    return checks[: digests.index(check.data_digest) + 1]


def since_base(checks: list[Check]) -> list[Check]:
    """Those that the charts are of: since the last new base."""
    begins = [place for place, check in enumerate(checks) if check.begins]
    return checks[begins[-1] :] if begins else checks
