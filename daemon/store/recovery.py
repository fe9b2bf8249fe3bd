"""A database that survives faults of the disk; used by one thread.

It sets a damaged file aside and begins a new one with the recoverable messages, notices
that the file was removed, and retries after errors of the disk.
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

from traverse.daemon.store.database import CORRUPT_INDEX, MessageDatabase
from traverse.daemon.store.queries import COLUMNS, stored_message
from traverse.daemon.store.records import (
    DatabaseRefusedError,
    NewMessage,
    Replaced,
    SetAside,
    StorageError,
    StoredMessage,
    StoreStatistics,
    StoreStatus,
)
from traverse.daemon.store.tables import read_as_text
from traverse.plurals import counted
from traverse.strict_toml.ownership import refused_owner

log = logging.getLogger("traverse.daemon.outbox")
T = TypeVar("T")

SESSIONS = "SELECT session, CAST(begun_ns AS INTEGER), note FROM sessions"
# By the index, which leaves the pages alone of what has been sent; and from both ends.
UNSENT = (
    "SELECT number FROM messages INDEXED BY unsent WHERE sent = 0",
    "SELECT number FROM messages NOT INDEXED WHERE sent = 0 ORDER BY number",
    "SELECT number FROM messages NOT INDEXED WHERE sent = 0 ORDER BY number DESC",
)
RETRY_REMARK = "; the daemon continues as soon as it can write"
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
# The same connection would never be able to write again.
REOPENED = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)
MAX_NAMED = 5
DATABASE_SUFFIXES = ("", "-wal", "-shm")


def storage_error_of(error: BaseException, path: Path) -> StorageError:
    """Describe why points cannot be stored in a file, and the remedy."""
    code = _code(error)
    number = error.errno if isinstance(error, OSError) else None
    folder = path.parent
    if path.exists() and not path.is_file():
        text, remedy = "it is no regular file", f"move {path} away"
    elif path.is_symlink() and not path.exists():
        text, remedy = (
            "it is a link to no file",
            f"correct the link, or move {path} away",
        )
    elif code == sqlite3.SQLITE_FULL or number in (errno.ENOSPC, errno.EDQUOT):
        text, remedy = "the disk is full", f"make room on the disk of {folder}"
    elif (code in REOPENED or number == errno.EROFS) and (why := _of_disk(folder)):
        text, remedy = why
    elif (code in REOPENED or number == errno.EACCES) and (owner := _owner_of(path)):
        text, _, remedy = owner.partition("; ")
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
    reason = f"{error} ({name})" if name else str(error) or type(error).__name__
    return StorageError(f"the outbox {path}: {text}: {reason}", remedy + RETRY_REMARK)


def _of_disk(folder: Path) -> tuple[str, str] | None:
    """Return why no file of a folder can be opened to write, by its disk."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        return None
    if disk.f_flag & os.ST_RDONLY:
        return "the disk is mounted read-only", f"mount that of {folder} to be written"
    if disk.f_files and not disk.f_ffree:
        return (
            "the disk has no inodes left: it holds too many files",
            f"remove files from the disk of {folder}",
        )
    return None


def _owner_of(path: Path) -> str:
    """Return whose the file of a database is that may not be used; empty for none."""
    files = (Path(f"{path}{suffix}") for suffix in DATABASE_SUFFIXES)
    return next(filter(None, map(refused_owner, files)), "")


def move_aside(path: Path) -> Path:
    """Rename a damaged database and its log; return the new name.

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
    code = getattr(error, "sqlite_errorcode", None)
    return None if code is None else int(code) & 0xFF


class UnsentMessages:
    """Unsent messages of an abandoned database."""

    def __init__(self) -> None:
        self._numbers: set[int] = set()
        self._found: dict[int, NewMessage] = {}

    @property
    def messages(self) -> list[NewMessage]:
        """Readable ones, in order."""
        return [self._found[number] for number in sorted(self._found)]

    @property
    def n_lost(self) -> int:
        return len(self._numbers) - len(self._found)

    def read(self, connection: sqlite3.Connection) -> None:
        """Add what a connection can read, message by message.

        Pages cached by one connection may be lost to another.
        """
        connection.text_factory = read_as_text
        begun: dict[str, tuple[int, str]] = {}
        with contextlib.suppress(sqlite3.Error):
            for session, begun_ns, note in connection.execute(SESSIONS):
                begun[session] = begun_ns, note
        for query in UNSENT:
            with contextlib.suppress(sqlite3.Error):
                for (number,) in connection.execute(query):
                    self._numbers.add(number)
        for number in self._numbers:
            with contextlib.suppress(sqlite3.Error):
                for row in connection.execute(
                    f"SELECT {COLUMNS} FROM messages WHERE number = ?", (number,)
                ):
                    message = stored_message(row)
                    if message.is_whole:
                        values = *row[:7], *begun.get(message.session, (0, ""))
                        self._found.setdefault(number, NewMessage(*values))


Remedy = Callable[[sqlite3.Error], None]


class ResilientDatabase:
    """Stores messages, or reports why it cannot.

    Args:
        notify: called when a damaged or incomplete database was replaced, and when
            messages were set aside.

    Attributes:
        trouble: why messages cannot be stored now, or None.
    """

    def __init__(
        self, path: Path, notify: Callable[[Replaced | SetAside], None]
    ) -> None:
        self._path = path
        self._notify = notify
        self._store: MessageDatabase | None = None
        self._last_number = 0
        self._statistics = StoreStatistics()
        self._unsent = UnsentMessages()  # what the next one is to have
        self._why = ""  # the last one is not used any more
        self.trouble: StorageError | None = None

    def open(self) -> None:
        """Open the database; sets `trouble` on failure.

        Raises:
            DatabaseRefusedError: it must be left alone.
        """
        with contextlib.suppress(sqlite3.Error, OSError):
            self.run(lambda store: None)

    def close(self) -> None:
        if self._store is not None:
            store, self._store = self._store, None
            self._last_number = store.last_number
            try:
                store.close()
            except sqlite3.Error as error:
                log.warning("%s", storage_error_of(error, self._path).text)

    def add(self, messages: Sequence[NewMessage]) -> list[int]:
        """Store messages, all or none, synced; return their numbers.

        Raises:
            Exception: they are not stored; `trouble` has the reason.
        """
        numbers = self.run(lambda store: store.add(messages))
        self.trouble = None
        return numbers

    def run(self, work: Callable[[MessageDatabase], T]) -> T:
        """Run a job, with a new database if it turns out damaged.

        Raises:
            Exception: it cannot be done; `trouble` has the reason.
        """
        tried: list[Remedy] = []
        try:
            while True:
                try:
                    return work(self._opened())
                except sqlite3.Error as error:
                    remedy = self._remedy(error)
                    if remedy is None or remedy in tried:
                        raise
                    tried.append(remedy)
                    remedy(error)
        except DatabaseRefusedError as error:
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
        """Check whether the trouble is over, and the files still there."""
        try:
            is_unchanged = self._store is None or self._store.is_file_unchanged
        except sqlite3.Error:  # the next work with it reports that
            is_unchanged = True
        if not is_unchanged:
            self._open_anew(None)
            self.open()
        if self.trouble is not None:
            with contextlib.suppress(sqlite3.Error, OSError, DatabaseRefusedError):
                self.run(MessageDatabase.check_space)
                self.trouble = None

    def status(self) -> StoreStatus:
        """Return its state, with the latest readable statistics."""
        if self._store is not None:
            with contextlib.suppress(sqlite3.Error):
                self._statistics = self._store.statistics()
        return StoreStatus(self.trouble, self._statistics)

    def _opened(self) -> MessageDatabase:
        if self._store is None:
            store = MessageDatabase(self._path, self._last_number, self._set_aside)
            try:
                numbers = store.add_missing(self._unsent.messages)
            except BaseException:
                store.close()
                raise
            self._store = store
            self._last_number = store.last_number
            if self._why or store.n_missing:
                self._notify(Replaced(self._account(store, len(numbers))))
            self._unsent, self._why = UnsentMessages(), ""
        return self._store

    def _account(self, store: MessageDatabase, n_taken: int) -> str:
        """Describe what became of the stored messages."""
        known, is_new = store.known, store.is_new
        parts = [
            self._why
            or f"{self._path} lacks messages that had been stored: it, or its log, was "
            "damaged, cut off or removed, or is an older copy"
        ]
        if is_new or n_taken:
            begun = "a new one has been begun, " if is_new else ""
            parts.append(
                f"{begun}with {counted(n_taken, 'point')} that had not been sent"
            )
        if self._unsent.n_lost:
            parts.append(f"{self._unsent.n_lost} more of those cannot be read")
        if store.n_missing:
            n_unsent = max(0, min(known.unsent, store.n_missing) - n_taken)
            which = "all" if is_new else f"the last {store.n_missing}"
            besides = " others" * (n_taken > 0)
            parts.append(
                f"it lacks {which}{besides} up to seq {known.seq} of session "
                f"{known.session[:64]!r}, of which the broker did not have {n_unsent}"
            )
        return "; ".join(parts)

    def _remedy(self, error: sqlite3.Error) -> Remedy | None:
        """Return the remedy for an error; None: to wait."""
        if error.sqlite_errorcode == CORRUPT_INDEX and self._store is not None:
            return self._rebuild_indices
        if error.sqlite_errorcode == sqlite3.SQLITE_IOERR_SHORT_READ:
            return self._open_anew
        return self._begin_anew if _code(error) in DAMAGED else None

    def _rebuild_indices(self, error: sqlite3.Error) -> None:
        """Rebuild indices that do not fit a damaged row, so that it can be deleted."""
        log.warning("%s: %s; the indices are built anew", self._path, error)
        if self._store is not None:
            with contextlib.suppress(sqlite3.Error):
                self._store.connection.execute("REINDEX")

    def _open_anew(self, _: object) -> None:
        """Open the present file, and add what only the lost one had."""
        if self._store is not None:
            self._unsent.read(self._store.connection)
        self._why = (
            f"{self._path} or its log had been moved, removed or cut off while the "
            "daemon used it; what is there now is used instead"
        )
        self.close()

    def _begin_anew(self, error: sqlite3.Error) -> None:
        """Set a damaged database aside, and take over its readable rows."""
        name = move_aside(self._path)
        address = f"file:{quote(os.fsencode(name))}?mode=ro"
        with contextlib.closing(sqlite3.connect(address, uri=True)) as connection:
            self._unsent.read(connection)
        if self._store is not None:
            self._unsent.read(self._store.connection)
        self.close()
        self._why = f"{self._path} is damaged ({error}); it is now {name}"

    def _set_aside(self, damaged: Sequence[StoredMessage]) -> None:
        which = ", ".join(
            f"seq {message.seq!r:.20} of session {message.session!r:.64}"
            for message in damaged[:MAX_NAMED]
        )
        unnamed = f" and {len(damaged) - MAX_NAMED} more" * (len(damaged) > MAX_NAMED)
        text = f"{self._path}: damaged and not sent: {which}{unnamed}"
        self._notify(SetAside(text, len(damaged)))
