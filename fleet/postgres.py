"""PostgreSQL by psycopg."""

import contextlib
from collections.abc import Iterable, Iterator
from typing import Any
from urllib.parse import urlsplit

import psycopg
from psycopg.conninfo import make_conninfo

from traverse.fleet.database import (
    BadValueError,
    Run,
    StoreAwayError,
    StoreRefusedError,
    Values,
)

_MIGRATION = 0x7472617665727365
"""Number of the lock under which tables are changed: "traverse"."""


class PostgresDatabase:
    """A database of a server, connected when it is used first.

    Args:
        url: `postgresql://user@host:port/database`; a password is better in the file
            that libpq reads (`PGPASSFILE`).

    Raises:
        StoreRefusedError: it is no such address.
    """

    def __init__(self, url: str) -> None:
        try:
            self._address = make_conninfo(url, connect_timeout=5)
        except psycopg.ProgrammingError as error:
            raise StoreRefusedError(
                f"{str(error).strip()}; expected postgresql://user@host/database"
            ) from error
        parts = urlsplit(url)
        self.name = f"postgresql://{parts.netloc.rpartition('@')[2]}{parts.path}"
        self._connection: psycopg.Connection | None = None

    @contextlib.contextmanager
    def transaction(self) -> Iterator[Run]:
        try:
            connection = self._connected()
            with connection.transaction(), connection.cursor() as cursor:

                def run(statement: str, values: Values = ()) -> list[tuple[Any, ...]]:
                    cursor.execute(statement, values)
                    return cursor.fetchall() if cursor.description else []

                yield run
        except (psycopg.OperationalError, psycopg.InterfaceError) as error:
            self.close()
            raise StoreAwayError(f"{self.name}: {_line(error)}") from error
        except (psycopg.DataError, psycopg.IntegrityError) as error:
            raise BadValueError(_line(error)) from error
        except psycopg.Error as error:
            raise StoreRefusedError(f"{self.name}: {_line(error)}") from error

    def many(self, run: Run, statement: str, rows: Iterable[Values]) -> None:
        """As of `Database`: sent together, answered together."""
        if self._connection is None:
            raise StoreAwayError(f"{self.name}: not connected")
        with self._connection.cursor() as cursor:
            cursor.executemany(statement, rows)

    def lock_tables(self, run: Run) -> None:
        run("SELECT pg_advisory_xact_lock(%s)", (_MIGRATION,))

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _connected(self) -> psycopg.Connection:
        if self._connection is None or self._connection.closed:
            self._connection = psycopg.connect(self._address, autocommit=True)
        return self._connection


def _line(error: psycopg.Error) -> str:
    return " ".join(str(error).split())
