"""A database that survives faults of the disk; used by one thread.

Opens the file, moves a damaged one aside and begins a new one with the messages that
can be recovered, notices that the file has been removed, and tries again where the disk
had no room or gave errors.
"""

import contextlib
import errno
import logging
import os
import sqlite3
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar
from urllib.parse import quote

from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import COLUMNS, block_id
from traverse.daemon.store.records import (
    NewMessage,
    StorableMessage,
    StorageError,
    StoreRefusedError,
    StoreStatistics,
    StoreStatus,
)
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point, Scan

log = logging.getLogger("traverse.daemon.outbox")
T = TypeVar("T")

# By the index first: it leaves the pages alone that only hold what has been sent.
WAYS = ("INDEXED BY unsent", "NOT INDEXED")
RETRY_REMARK = "; the daemon continues as soon as it can write"
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
# The same connection would never be able to write again.
REOPENED = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
DATABASE_SUFFIXES = ("", "-wal", "-shm")


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
        remedy = f"check the disk of {folder} and the system's log"
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


def recover_unsent(path: Path) -> list[NewMessage]:
    """Messages that were not sent and can be read, in order, without repeats."""
    found: dict[str, tuple[int, NewMessage]] = {}
    begun: dict[str, tuple[int, str]] = {}
    address = f"file:{quote(str(path))}?mode=ro"
    with contextlib.closing(sqlite3.connect(address, uri=True)) as connection:
        with contextlib.suppress(sqlite3.Error):
            for session, begun_ns, note in connection.execute("SELECT * FROM sessions"):
                begun[session] = begun_ns, note
        for way in WAYS:
            with contextlib.suppress(sqlite3.Error, ValueError, TypeError):
                for *values, number, _ in connection.execute(
                    f"SELECT {COLUMNS} FROM messages {way} WHERE sent = 0 "
                    "ORDER BY number"
                ):
                    row = (*values, *begun.get(values[0], (0, "")))
                    message = NewMessage(*row)
                    if _is_whole(message):
                        found.setdefault(message.id, (number, message))
    return [message for _, message in sorted(found.values(), key=lambda row: row[0])]


def _is_whole(message: StorableMessage) -> bool:
    """Whether the payload is the point, or the block of a scan, of its row."""
    try:
        if message.topic.endswith("/scan"):
            block = decode(Scan, message.payload, message.encoding)
            found = block.scan, block.seq, block_id(block)
        else:
            point = decode(Point, message.payload, message.encoding)
            found = point.session, point.seq, point.id
    except MessageError:
        return False
    return found == (message.session, message.seq, message.id)


class ResilientDatabase:
    """Store messages, or report why it cannot.

    Args:
        path: of the database.
        replaced: called with a text when a new database has been begun for one that
            was damaged.

    Attributes:
        trouble: why messages cannot be stored now; None while they can.
    """

    def __init__(self, path: Path, replaced: Callable[[str], None]) -> None:
        self._path = path
        self._replaced = replaced
        self._store: MessageDatabase | None = None
        self._last_number = 0
        self._statistics = StoreStatistics()
        self.trouble: StorageError | None = None

    def open(self) -> None:
        """Open the database; what prevents it is in `trouble` then.

        Raises:
            StoreRefusedError: it must be left alone.
        """
        with contextlib.suppress(sqlite3.Error, OSError):
            self.run(lambda store: None)

    def close(self) -> None:
        """Close the database."""
        if self._store is not None:
            store, self._store = self._store, None
            self._last_number = store.last_number
            try:
                store.close()
            except sqlite3.Error as error:
                log.warning("%s", storage_error_of(error, self._path).text)

    def add(self, messages: Sequence[NewMessage]) -> list[int]:
        """Store messages, all or none; gives their numbers. On return they are safe.

        Raises:
            Exception: they are not stored; `trouble` has the reason.
        """
        numbers = self.run(lambda store: store.add(messages))
        self.trouble = None
        return numbers

    def run(self, work: Callable[[MessageDatabase], T]) -> T:
        """Do something with the database; with a new one if it turns out damaged.

        Raises:
            Exception: it cannot be done; `trouble` has the reason.
        """
        try:
            try:
                return work(self._opened())
            except sqlite3.Error as error:
                if _code(error) not in DAMAGED:
                    raise
                self._begin_anew(error)
                return work(self._opened())
        except StoreRefusedError as error:
            self.trouble = StorageError(str(error), "see there")
            raise
        except Exception as error:
            if not isinstance(error, sqlite3.Error | OSError):
                log.exception("fault in the outbox")
            self.trouble = storage_error_of(error, self._path)
            if _code(error) in REOPENED:
                self.close()
            raise

    def check(self) -> None:
        """See whether the trouble is over, and whether the file is still there."""
        if self._store is not None and not self._store.is_file_unchanged:
            self.close()
            with contextlib.suppress(sqlite3.Error, OSError, StoreRefusedError):
                self.run(lambda store: None)
                self._replaced(
                    f"{self._path} had been moved or removed while the daemon used it; "
                    "what is there now is used instead"
                )
        if self.trouble is not None:
            with contextlib.suppress(sqlite3.Error, OSError, StoreRefusedError):
                self.run(MessageDatabase.check_space)
                self.trouble = None

    def status(self) -> StoreStatus:
        """How it is; the statistics are those of when it could last be read."""
        if self._store is not None:
            with contextlib.suppress(sqlite3.Error):
                self._statistics = self._store.statistics()
        return StoreStatus(self.trouble, self._statistics)

    def _opened(self) -> MessageDatabase:
        if self._store is None:
            self._store = MessageDatabase(self._path, self._last_number)
            self._last_number = max(self._last_number, self._store.last_number)
        return self._store

    def _begin_anew(self, error: sqlite3.Error) -> None:
        """Set a damaged database aside; a new one gets what can be taken over."""
        self.close()
        name = move_aside(self._path)
        store, entries = self._opened(), []
        with contextlib.suppress(sqlite3.Error):
            entries = recover_unsent(name)
            if entries:
                store.add(entries)
        self._replaced(
            f"{self._path} is damaged ({error}); it is now {name}, and a new one has "
            f"been begun, with {len(entries)} points that had not been sent"
        )
