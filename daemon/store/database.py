"""Database of captured messages, and which of them the broker has.

One SQLite file with a write-ahead log. `add` returns after syncing to the disk
(synchronous = FULL). Other writes are not synced, since a power cut may lose them
without harm: a point no longer marked as sent is sent again, with the same id.

One thread opens and uses it. Every call is one transaction.

Each message has a checksum. A damaged message is set aside: it stays in the file and is
not sent. Deleting it would need sound indices.
"""

import contextlib
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Concatenate, ParamSpec

from traverse.daemon.store.last_stored import OWNER_ONLY, LastStored, LastStoredFile
from traverse.daemon.store.records import NewMessage, StoredMessage, StoreStatistics
from traverse.daemon.store.tables import (
    BELIEVED,
    COLUMNS,
    SET_ASIDE,
    create_tables,
    has_tables,
    read_as_text,
)
from traverse.daemon.store.watched_files import WatchedFiles

P = ParamSpec("P")

BUSY_S = 1.0
CHECKED_BYTES = 64 << 20  # a larger file takes too long to be checked at each start
LOG_PAGES = 1000
LOG_BYTES = 16 << 20  # the log shrinks to this when it begins anew
ROOM_BYTES = 65_536  # what a few points take, with their part of every index
VACUUM_PAGES = 128
DAY_NS = 86_400 * 10**9
NOTE_BELIEVED_NS = 3_600 * 10**9
NOTE_S = 0.2  # at most so often, since it takes as long as to store a point
ROWS = 100  # of one statement


CORRUPT_INDEX = sqlite3.SQLITE_CORRUPT | (3 << 8)  # its name is new in Python 3.12


class MessageDatabase:
    """The database of one arm.

    Args:
        path: of the file; created if missing.
        last_number: messages are numbered after this.
        on_set_aside: called with damaged messages.

    Attributes:
        last_number: of the message stored last.
        is_new: it never had a message when it was opened.
        n_missing: messages stored last that were missing when it was opened.
        known: record of the messages stored before.
        connection: for queries; see `traverse.daemon.store.queries`.

    Raises:
        DatabaseRefusedError: it is not an outbox, or of another version.
        sqlite3.Error: it cannot be opened, or is damaged.
    """

    def __init__(
        self,
        path: Path,
        last_number: int = 0,
        on_set_aside: Callable[[Sequence[StoredMessage]], None] = lambda _: None,
    ) -> None:
        self._path = path
        self._files = WatchedFiles()
        self._log_path = path.with_name(f"{path.name}-wal")
        self._on_set_aside = on_set_aside
        if not path.exists():  # SQLite would let everybody read it
            with contextlib.suppress(OSError):  # SQLite says what is wrong
                path.touch(OWNER_ONLY)
        with contextlib.ExitStack() as stack:
            self.connection = stack.enter_context(
                contextlib.closing(
                    sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
                )
            )
            self.connection.text_factory = read_as_text
            is_new = not has_tables(self.connection, str(path))
            self._last_stored = stack.enter_context(
                contextlib.closing(LastStoredFile(path))
            )
            self._begin(last_number, is_new=is_new)
            self._open = stack.pop_all()

    def _begin(self, last_number: int, *, is_new: bool) -> None:
        connection = self.connection
        execute = connection.execute
        if is_new:
            execute("PRAGMA auto_vacuum = INCREMENTAL")
        elif self._path.stat().st_size <= CHECKED_BYTES:
            (verdict,) = execute("PRAGMA quick_check(1)").fetchone()
            if verdict != "ok":
                error = sqlite3.DatabaseError(verdict)
                error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
                raise error
        execute("PRAGMA journal_mode = WAL")
        execute("PRAGMA synchronous = FULL")
        execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
        execute(f"PRAGMA journal_size_limit = {LOG_BYTES}")
        if is_new:
            create_tables(connection)
        # Counted once, then kept up: to count a million takes a while.
        (self._points,) = execute("SELECT count(*) FROM messages").fetchone()
        (self._unsent,) = execute(
            "SELECT count(*) FROM messages INDEXED BY unsent WHERE sent = 0"
        ).fetchone()
        row = execute(
            "SELECT seq FROM sqlite_sequence WHERE name = 'messages'"
        ).fetchone()
        found_number = int(row[0]) if row else 0
        self.known = self._last_stored.read()
        self.last_number = max(found_number, last_number, self.known.number)
        self.is_new = not found_number
        self.n_missing = self.last_number - found_number
        if self.n_missing:
            execute("UPDATE sqlite_sequence SET seq = ?", (self.last_number,))
        for path in (self._path, self._log_path):
            with contextlib.suppress(OSError):  # not ours
                path.chmod(OWNER_ONLY)
        self._believed_ns: int | None = None
        self._believed_noted_ns = 0
        self._session = "", 0, ""  # one that is in the table
        self._noted_s = -NOTE_S
        self._note_files()

    def close(self) -> None:
        self._last_stored.write(self.known)
        self._open.close()

    @property
    def is_file_unchanged(self) -> bool:
        """Whether file and log are those that were opened, and not truncated.

        Raises:
            sqlite3.Error: the database cannot be read.
        """
        if not self._files.are_unchanged:
            return False
        self._note_files()
        self._note_last()
        return True

    def _note_files(self) -> None:
        n_bytes, _ = self._size()
        self._files.note({self._path: n_bytes, self._log_path: LOG_BYTES})

    def _note_last(self) -> None:
        """Record the last message in the file beside the database."""
        self._noted_s = time.monotonic()
        self._last_stored.write(self.known)
        self._files.note_growth(self._log_path, LOG_BYTES)

    def _size(self) -> tuple[int, int]:
        """Return bytes of the database, and how many are in use."""
        ((pages, free, page_bytes),) = self.connection.execute(
            "SELECT page_count, freelist_count, page_size "
            "FROM pragma_page_count, pragma_freelist_count, pragma_page_size"
        )
        return pages * page_bytes, (pages - free) * page_bytes

    # -- writing --------------------------------------------------------------

    def add(self, entries: Sequence[NewMessage]) -> list[int]:
        """Store messages, all or none, synced; return their numbers."""
        if not entries:
            return []
        numbers = range(self.last_number + 1, self.last_number + 1 + len(entries))
        sessions = {(e.session, e.begun_ns, e.note): None for e in entries}
        sessions.pop(self._session, None)
        # One statement is a transaction. Each releases the interpreter, and waits for
        # it afterwards.
        is_one = not sessions and len(entries) <= ROWS
        with (
            contextlib.nullcontext(self.connection.execute)
            if is_one
            else self._transaction()
        ) as execute:
            for row in sessions:
                execute("INSERT OR IGNORE INTO sessions VALUES (?, ?, ?)", row)
            for begin in range(0, len(entries), ROWS):
                part = slice(begin, begin + ROWS)
                values = [
                    value
                    for number, e in zip(numbers[part], entries[part], strict=True)
                    for value in (
                        *(number, e.session, e.seq, e.id, e.time_ns, e.topic),
                        *(e.encoding, e.payload, e.checksum, e.request),
                    )
                ]
                rows = ", ".join(
                    ["(?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"] * len(numbers[part])
                )
                execute(f"INSERT INTO messages ({COLUMNS}) VALUES {rows}", values)
        self._points += len(numbers)
        self._unsent += len(numbers)
        self.last_number, last = numbers[-1], entries[-1]
        self._session = last.session, last.begun_ns, last.note
        self.known = LastStored(self.last_number, last.session, last.seq, self._unsent)
        if time.monotonic() >= self._noted_s + NOTE_S:
            self._note_last()
        return list(numbers)

    def add_missing(self, entries: Sequence[NewMessage]) -> list[int]:
        """Store messages of another database that are missing here; as `add`."""
        held = "SELECT 1 FROM messages WHERE id = ? OR (session = ? AND seq = ?)"
        return self.add(
            [
                entry
                for entry in entries
                if not self.connection.execute(
                    held, (entry.id, entry.session, entry.seq)
                ).fetchone()
            ]
        )

    def mark_sent(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Mark messages in ranges of numbers, inclusive, as sent."""
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
        self.known = replace(self.known, unsent=self._unsent)

    def delete_old(
        self, *, before_ns: int, keep_bytes: int, running: str, at_most: int
    ) -> int:
        """Remove the oldest messages if they are too old [UTC ns], or too many.

        Messages that the broker lacks, and all after them, stay. Old ones are removed
        in order of arrival up to the first that is not old, and never of the running
        session: the clock may have been wrong. Returns how many.
        """
        used_bytes = self.statistics().used_bytes
        oldest = self.connection.execute(
            "SELECT number, session, time_ns FROM messages WHERE number < coalesce("
            "(SELECT number FROM messages INDEXED BY unsent WHERE sent = 0 "
            "ORDER BY number LIMIT 1), ?) AND sent <> ? ORDER BY number LIMIT ?",
            (self.last_number + 1, SET_ASIDE, at_most),
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
            self._session = "", 0, ""
        return len(oldest)

    def believed_ns(self, advanced: Callable[[int], int]) -> int:
        """Advance the trusted UTC and return it; 0 while there is none.

        Args:
            advanced: computes it from the previous one, 0 at first.
        """
        execute = self.connection.execute
        if self._believed_ns is None:
            with self._unsynced(), self._transaction():
                execute(BELIEVED)
            row = execute("SELECT utc_ns FROM believed").fetchone()
            self._believed_ns = self._believed_noted_ns = int(row[0]) if row else 0
        if not (now_ns := advanced(self._believed_ns)):
            return 0
        self._believed_ns = now_ns
        if now_ns - self._believed_noted_ns >= NOTE_BELIEVED_NS:
            self._believed_noted_ns = now_ns
            with self._unsynced(), self._transaction():
                execute("INSERT OR REPLACE INTO believed VALUES (1, ?)", (now_ns,))
        return now_ns

    def trim_file(self) -> None:
        """Return free pages to the file system, and empty the log."""
        execute = self.connection.execute
        with self._unsynced():
            if execute("PRAGMA freelist_count").fetchone()[0] >= VACUUM_PAGES:
                # `execute` would stop after the first page.
                self.connection.executescript(
                    f"PRAGMA incremental_vacuum({VACUUM_PAGES})"
                )
            execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()
        self._note_files()  # they may be shorter now

    def check_space(self) -> None:
        """Write and sync as much as a few points need, then remove it.

        Raises:
            sqlite3.Error: a point could not be stored.
        """
        filler = "INSERT OR REPLACE INTO room VALUES (1, zeroblob(?))"
        with self._transaction() as execute:
            execute(filler, (ROOM_BYTES,))
        with self._transaction() as execute:
            execute(filler, (0,))

    def _set_aside(self, damaged: Sequence[StoredMessage]) -> None:
        """Mark damaged messages, which are never sent."""
        with self._unsynced(), self._transaction() as execute:
            for message in damaged:
                execute(
                    f"UPDATE messages SET sent = {SET_ASIDE} WHERE number = ?",
                    (message.number,),
                )
        self._unsent -= sum(not message.is_sent for message in damaged)
        self._on_set_aside(damaged)

    # -- reading --------------------------------------------------------------

    def read(
        self,
        query: Callable[Concatenate[sqlite3.Connection, P], list[StoredMessage]],
        *arguments: P.args,
        **options: P.kwargs,
    ) -> list[StoredMessage]:
        """Run a query; set damaged messages aside."""
        seen: set[int] = set()
        while True:
            messages = query(self.connection, *arguments, **options)
            damaged = [message for message in messages if not message.is_whole]
            if not damaged:
                return messages
            if seen.intersection(message.number for message in damaged):
                error = sqlite3.DatabaseError("an index does not fit its table")
                error.sqlite_errorcode = CORRUPT_INDEX
                raise error
            seen.update(message.number for message in damaged)
            self._set_aside(damaged)

    def statistics(self) -> StoreStatistics:
        oldest = self.connection.execute(
            "SELECT time_ns FROM messages INDEXED BY unsent WHERE sent = 0 "
            "ORDER BY number LIMIT 1"
        ).fetchone()
        return StoreStatistics(
            self._points, self._unsent, *self._size(), oldest[0] if oldest else None
        )

    # -- transactions ---------------------------------------------------------

    @contextlib.contextmanager
    def _unsynced(self) -> Iterator[None]:
        """Do not sync writes within the block; a later `add` does."""
        self.connection.execute("PRAGMA synchronous = NORMAL")
        try:
            yield
        finally:
            self.connection.execute("PRAGMA synchronous = FULL")

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[Callable[..., sqlite3.Cursor]]:
        connection = self.connection
        connection.execute("BEGIN IMMEDIATE")
        try:
            yield connection.execute
            connection.execute("COMMIT")
        except BaseException:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
