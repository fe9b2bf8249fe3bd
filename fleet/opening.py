"""Which database an address names."""

from pathlib import Path

from traverse.fleet.database import Database, SqliteDatabase, StoreRefusedError


def open_database(url: str) -> Database:
    """Open `postgresql://...` or a file of SQLite, which is made where it is not there.

    Raises:
        StoreRefusedError: it is neither, or a library is missing.
    """
    if url.startswith(("postgresql://", "postgres://")):
        from traverse.fleet.postgres import PostgresDatabase  # noqa: PLC0415 - an extra

        return PostgresDatabase(url)
    if "://" in url:
        raise StoreRefusedError(
            f"{url.partition('://')[0]}://: no such database; expected a file's name "
            "or postgresql://user@host/database"
        )
    return SqliteDatabase(Path(url))
