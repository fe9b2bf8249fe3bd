"""PostgreSQL or SQLite behind one way to run statements.

Statements are written once, with %s for a value and what both understand
(`ON CONFLICT`). A connection is used by one thread at a time.
"""

import contextlib
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from traverse.strict_toml.ownership import refused_owner

_PATIENCE_S = 30.0
Values = Sequence[Any]
Run = Callable[..., list[tuple[Any, ...]]]
"""Runs one statement with its values; returns what it selects."""


class StoreRefusedError(Exception):
    """A store cannot be used as it is; names the remedy."""


class StoreAwayError(Exception):
    """The database cannot be reached, or broke off: trying again may do."""


class BadValueError(Exception):
    """The database does not take a value."""


class Database(Protocol):
    """A database with the tables of a store.

    Attributes:
        name: for people, without a password.
    """

    name: str

    def transaction(self) -> contextlib.AbstractContextManager[Run]:
        """Run statements: all of them, or none.

        Raises:
            StoreAwayError: it is not there, or has gone; nothing was kept.
            BadValueError: a value was not taken; nothing was kept.
        """

    def many(self, run: Run, statement: str, rows: Iterable[Values]) -> None:
        """Run a statement for each row, within a transaction."""

    def lock_tables(self, run: Run) -> None:
        """Keep others from changing the tables until the transaction's end."""

    def close(self) -> None:
        """End the connection."""


class SqliteDatabase:
    """A file, for members on one computer.

    Raises:
        StoreRefusedError: it cannot be opened, or is no database.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        try:
            self._connection = sqlite3.connect(
                path, timeout=_PATIENCE_S, isolation_level=None, check_same_thread=False
            )
            # FULL: a power cut takes back nothing that was acknowledged.
            self._connection.execute("PRAGMA synchronous = FULL")
            self._use_log()
        except sqlite3.Error as error:
            remedy = refused_owner(path) or "name a file that can be written"
            raise StoreRefusedError(f"{path}: {error}; {remedy}") from error

    def _use_log(self) -> None:
        """Readers do not wait for a writer; SQLite itself does not wait for this."""
        until_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                self._connection.execute("PRAGMA journal_mode = WAL")
                return
            except sqlite3.OperationalError:
                if time.monotonic() > until_s:
                    raise
                time.sleep(0.05)

    @contextlib.contextmanager
    def transaction(self) -> Iterator[Run]:
        cursor = self._connection.cursor()

        def run(statement: str, values: Values = ()) -> list[tuple[Any, ...]]:
            return cursor.execute(_with_marks(statement), values).fetchall()

        try:
            # At once, as one that becomes a writer later could not wait.
            cursor.execute("BEGIN IMMEDIATE")
            yield run
            cursor.execute("COMMIT")
        except (sqlite3.InterfaceError, sqlite3.ProgrammingError) as error:
            raise BadValueError(str(error)) from error
        except sqlite3.IntegrityError as error:
            raise BadValueError(str(error)) from error
        except sqlite3.Error as error:
            raise StoreAwayError(f"{self.name}: {error}") from error
        finally:
            if self._connection.in_transaction:
                self._connection.rollback()

    def many(self, run: Run, statement: str, rows: Iterable[Values]) -> None:
        for row in rows:
            run(statement, row)

    def lock_tables(self, run: Run) -> None:
        """See `Database`; SQLite has a single writer."""

    def close(self) -> None:
        self._connection.close()


def _with_marks(statement: str) -> str:
    return statement.replace("%s", "?")
