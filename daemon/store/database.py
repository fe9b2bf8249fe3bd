"""Points on disk: all that have been captured, and which of them the broker has.

One SQLite file with a write-ahead log. What `add` returns from is on the disk, synced
(synchronous = FULL). Everything else may be lost by a power cut without harm, and is
not synced: a point that is no longer marked as sent is sent again, with the same id.

One thread opens and uses it. Every call is one transaction, whole or not at all.
"""

import contextlib
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from traverse.daemon.store.records import NewMessage, StoreRefusedError, StoreStatistics

BUSY_S = 1.0
CHECKED_BYTES = 64 << 20  # a larger file takes too long to be checked at each start
LOG_PAGES = 1000
LOG_BYTES = 16 << 20  # the log shrinks to this when it begins anew
ROOM_BYTES = 65_536  # what a few points take, with their part of every index
VACUUM_PAGES = 128
DAY_NS = 86_400 * 10**9


VERSION = 1
APPLICATION = 0x54525650  # "TRVP", so that `file` and people can recognise it

TABLES = """
CREATE TABLE sessions (
    session TEXT PRIMARY KEY,
    begun_ns INTEGER NOT NULL,
    note TEXT NOT NULL
);
CREATE TABLE messages (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    session TEXT NOT NULL,
    seq INTEGER NOT NULL,
    id TEXT NOT NULL UNIQUE,
    time_ns INTEGER NOT NULL,
    topic TEXT NOT NULL,
    encoding TEXT NOT NULL,
    payload BLOB NOT NULL,
    sent INTEGER NOT NULL DEFAULT 0,
    UNIQUE (session, seq)
);
CREATE INDEX unsent ON messages (number) WHERE sent = 0;
CREATE TABLE room (only INTEGER PRIMARY KEY, filler BLOB NOT NULL);
"""


def check_version(connection: sqlite3.Connection, name: str) -> bool:
    """Whether the tables are there; False in a database that is new.

    Raises:
        StoreRefusedError: it is a newer one, or not an outbox.
        sqlite3.Error: it cannot be read.
    """
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if version == 0 and application == 0 and tables == 0:
        return False
    if application != APPLICATION:
        raise StoreRefusedError(
            f"{name}: is a database of another program (application_id "
            f"{application:#x}, expected {APPLICATION:#x}); move it away, or name "
            "another state folder"
        )
    if version != VERSION:
        raise StoreRefusedError(
            f"{name}: has tables of version {version}, this program knows version "
            f"{VERSION}; install the version of traverse that wrote it, or move the "
            "file away: its points can be sent and exported by that version only"
        )
    return True


def create_tables(connection: sqlite3.Connection, last_number: int) -> None:
    """Make all tables, whole or not at all; numbers continue after ``last_number``."""
    connection.execute("BEGIN IMMEDIATE")
    for statement in TABLES.split(";"):
        if statement.strip():
            connection.execute(statement)
    connection.execute(
        "INSERT INTO sqlite_sequence (name, seq) VALUES ('messages', ?)", (last_number,)
    )
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")
    connection.execute("COMMIT")


class MessageDatabase:
    """The database of one arm.

    Args:
        path: of the file; a new one is made where there is none.
        last_number: a new one numbers its messages after this.

    Raises:
        StoreRefusedError: it is not an outbox, or a newer one.
        sqlite3.Error: it cannot be opened, or is damaged.
    """

    def __init__(self, path: Path, last_number: int = 0) -> None:
        self._path = path
        self._connection = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
        try:
            self._begin(last_number)
        except BaseException:
            self._connection.close()
            raise

    def _begin(self, last_number: int) -> None:
        connection = self._connection
        execute = connection.execute
        is_there = check_version(connection, str(self._path))
        if not is_there:
            execute("PRAGMA auto_vacuum = INCREMENTAL")
        elif self._path.stat().st_size <= CHECKED_BYTES:
            (found,) = execute("PRAGMA quick_check(1)").fetchone()
            if found != "ok":
                error = sqlite3.DatabaseError(found)
                error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
                raise error
        execute("PRAGMA journal_mode = WAL")
        execute("PRAGMA synchronous = FULL")
        execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
        execute(f"PRAGMA journal_size_limit = {LOG_BYTES}")
        if not is_there:
            create_tables(connection, last_number)
        # Counted once, then kept up: to count a million takes a while.
        (self._points,) = execute("SELECT count(*) FROM messages").fetchone()
        (self._unsent,) = execute(
            "SELECT count(*) FROM messages INDEXED BY unsent WHERE sent = 0"
        ).fetchone()
        row = execute(
            "SELECT seq FROM sqlite_sequence WHERE name = 'messages'"
        ).fetchone()
        self.last_number = int(row[0]) if row else 0
        self._identity = self._path.stat().st_dev, self._path.stat().st_ino

    def close(self) -> None:
        """Close the file; the log is put into it where that is possible."""
        self._connection.close()

    @property
    def is_file_unchanged(self) -> bool:
        """Whether the file is still where it was opened, and the same."""
        try:
            found = self._path.stat()
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == self._identity

    # -- writing --------------------------------------------------------------

    def add(self, entries: Sequence[NewMessage]) -> list[int]:
        """Store messages, all or none; gives their numbers. On return they are safe."""
        with self._transaction() as execute:
            for row in {(e.session, e.begun_ns, e.note): None for e in entries}:
                execute("INSERT OR IGNORE INTO sessions VALUES (?, ?, ?)", row)
            numbers = [
                execute(
                    "INSERT INTO messages (session, seq, id, time_ns, topic, encoding, "
                    "payload) VALUES (?, ?, ?, ?, ?, ?, ?)",
                    (e.session, e.seq, e.id, e.time_ns, e.topic, e.encoding, e.payload),
                ).lastrowid
                or 0
                for e in entries
            ]
        self._points += len(numbers)
        self._unsent += len(numbers)
        self.last_number = numbers[-1] if numbers else self.last_number
        return numbers

    def mark_sent(self, ranges: Sequence[tuple[int, int]]) -> None:
        """The broker has all messages of some ranges of numbers, ends included."""
        with self._unsynced(), self._transaction() as execute:
            marked = sum(
                execute(
                    "UPDATE messages SET sent = 1 WHERE number BETWEEN ? AND ? "
                    "AND sent = 0",
                    ends,
                ).rowcount
                for ends in ranges
            )
        self._unsent -= marked

    def delete_old(
        self, *, before_ns: int, keep_bytes: int, running: str, at_most: int
    ) -> int:
        """Remove the oldest messages that are too old, or too many; gives how many.

        Never what the broker does not have yet, nor anything after that. What is too
        old is deleted in the order of arrival, up to the first that is not, and never
        of the running session: the clock may have been wrong.

        Args:
            before_ns: older ones are deleted [UTC].
            keep_bytes: while the file holds more than this, more are deleted.
            running: current session.
            at_most: so many are removed in this call.
        """
        used_bytes = self.statistics().used_bytes
        oldest = self._connection.execute(
            "SELECT number, session, time_ns FROM messages WHERE number < coalesce("
            "(SELECT number FROM messages INDEXED BY unsent WHERE sent = 0 "
            "ORDER BY number LIMIT 1), ?) ORDER BY number LIMIT ?",
            (self.last_number + 1, at_most),
        ).fetchall()
        if used_bytes <= keep_bytes:
            for place, (_, session, time_ns) in enumerate(oldest):
                if session == running or time_ns >= before_ns:
                    del oldest[place:]
                    break
        if oldest:
            with self._unsynced(), self._transaction() as execute:
                for number, _, _ in oldest:
                    execute("DELETE FROM messages WHERE number = ?", (number,))
                for session in {session for _, session, _ in oldest} - {running}:
                    execute(
                        "DELETE FROM sessions WHERE session = ? AND NOT EXISTS "
                        "(SELECT 1 FROM messages WHERE messages.session = ?)",
                        (session, session),
                    )
            self._points -= len(oldest)
        return len(oldest)

    def trim_file(self) -> None:
        """Return some free pages to the file system, and empty the log."""
        execute = self._connection.execute
        with self._unsynced():
            if execute("PRAGMA freelist_count").fetchone()[0] >= VACUUM_PAGES:
                # `execute` would stop after the first page.
                self._connection.executescript(
                    f"PRAGMA incremental_vacuum({VACUUM_PAGES})"
                )
            execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()

    def check_space(self) -> None:
        """Write and sync as much as a few points need, and take it back.

        Raises:
            sqlite3.Error: a point could not be kept.
        """
        filler = "INSERT OR REPLACE INTO room VALUES (1, zeroblob(?))"
        with self._transaction() as execute:
            execute(filler, (ROOM_BYTES,))
        with self._transaction() as execute:
            execute(filler, (0,))

    # -- reading --------------------------------------------------------------

    @property
    def connection(self) -> sqlite3.Connection:
        """For what only reads; see `traverse.daemon.store.queries`."""
        return self._connection

    def statistics(self) -> StoreStatistics:
        """How the database is now."""
        execute = self._connection.execute
        ((pages, free, page_bytes),) = execute(
            "SELECT page_count, freelist_count, page_size "
            "FROM pragma_page_count, pragma_freelist_count, pragma_page_size"
        )
        oldest = execute(
            "SELECT time_ns FROM messages INDEXED BY unsent WHERE sent = 0 "
            "ORDER BY number LIMIT 1"
        ).fetchone()
        return StoreStatistics(
            self._points,
            self._unsent,
            pages * page_bytes,
            (pages - free) * page_bytes,
            oldest[0] if oldest else None,
        )

    # -- transactions ---------------------------------------------------------

    @contextlib.contextmanager
    def _unsynced(self) -> Iterator[None]:
        """What is written may be lost by a power cut; later `add`s sync it, too."""
        self._connection.execute("PRAGMA synchronous = NORMAL")
        try:
            yield
        finally:
            self._connection.execute("PRAGMA synchronous = FULL")

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        """All of it, or nothing."""
        connection = self._connection
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield connection.execute
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
