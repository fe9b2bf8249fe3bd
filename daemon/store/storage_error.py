"""What went wrong with the outbox's file, in words that say what to do."""

import errno
import os
import sqlite3
from datetime import UTC, datetime
from pathlib import Path

from traverse.daemon.store.records import StorageError

RETRY_REMARK = "; the daemon goes on by itself as soon as it can write"
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
REOPENED = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
DATABASE_SUFFIXES = ("", "-wal", "-shm")


def is_corruption(error: BaseException) -> bool:
    """The file is no good any more."""
    return _code(error) in DAMAGED


def needs_reopening(error: BaseException) -> bool:
    """The same connection would never be able to write again."""
    return _code(error) in REOPENED


def storage_error_of(error: BaseException, path: Path) -> StorageError:
    """Why points cannot be kept in a file, and what to do."""
    code = _code(error)
    number = error.errno if isinstance(error, OSError) else None
    folder = path.parent
    if code == sqlite3.SQLITE_FULL or number in (errno.ENOSPC, errno.EDQUOT):
        text, remedy = "the disk is full", f"make room on the disk of {folder}"
    elif code == sqlite3.SQLITE_READONLY or number == errno.EROFS:
        text = "the file cannot be written"
        remedy = f"make {folder} and its files writable for the daemon's user"
    elif code == sqlite3.SQLITE_CANTOPEN or isinstance(error, PermissionError):
        text = "the file cannot be opened"
        remedy = f"make {folder} and its files accessible to the daemon's user"
    elif code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        text = "another program holds the database"
        remedy = "end the program that writes to it"
    elif code == sqlite3.SQLITE_IOERR or number is not None:
        text = "the disk does not read or write"
        remedy = f"check the disk of {folder}, and what the system's log says of it"
    else:
        text, remedy = "an unexpected fault", "report it with the daemon's log"
    name = getattr(error, "sqlite_errorname", "")
    said = f"{error} ({name})" if name else str(error) or type(error).__name__
    return StorageError(f"the outbox {path}: {text}: {said}", remedy + RETRY_REMARK)


def move_aside(path: Path) -> Path:
    """Give a damaged database another name, with its log; gives that name.

    Raises:
        OSError: that was not possible.
    """
    stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    name, n = f"{path}.corrupt-{stamp}", 1
    while os.path.lexists(name):
        name, n = f"{path}.corrupt-{stamp}-{n}", n + 1
    for end in DATABASE_SUFFIXES:
        old = Path(f"{path}{end}")
        if old.exists():
            old.rename(f"{name}{end}")
    return Path(name)


def _code(error: BaseException) -> int | None:
    """The primary result code of SQLite."""
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else int(code) & 0xFF
