"""Read-only queries, for the daemon and for commands beside it.

A command opens the file read-only and reads small pieces, so that it blocks neither the
daemon's writes nor the truncation of its log.

A scan block is stored with the scan as session and the number of its first point; the
note of that "session" is the real session's name.
"""

import os
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from traverse.daemon.store.records import (
    DatabaseRefusedError,
    StoredMessage,
    StoredRange,
    StoredSession,
)
from traverse.daemon.store.tables import SET_ASIDE, has_tables, read_as_text
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Scan

COLUMNS = "session, seq, id, time_ns, topic, encoding, payload, number, sent, crc"
PIECE = 500


def stored_message(row: tuple[Any, ...]) -> StoredMessage:
    """Convert a row of `COLUMNS`, verified by its checksum."""
    values = *row[:-2], bool(row[-2])
    message = StoredMessage(*values)
    return message if _is_whole(message, row[-1]) else replace(message, is_whole=False)


def _is_whole(message: StoredMessage, crc: int | None) -> bool:
    """Whether a message is as it was stored."""
    try:
        return message.checksum == crc
    except (TypeError, ValueError, AttributeError):
        return False  # of damaged columns not even the type is certain


def open_read_only(path: Path) -> sqlite3.Connection:
    """Open an outbox read-only, beside a running daemon.

    Raises:
        DatabaseRefusedError: there is none, or not one of this version.
        sqlite3.Error: it cannot be read.
    """
    if not path.is_file():
        problem = "is no regular file, or a link to none"
        if path.is_dir():
            problem = "is a folder"
        elif not path.is_symlink() and not path.exists():
            problem = "there is no such file"
        raise DatabaseRefusedError(
            f"{path}: {problem}; name the outbox of a daemon with --db, or its "
            "configuration with --config"
        )
    connection = sqlite3.connect(
        f"file:{quote(os.fsencode(path))}?mode=ro", uri=True, isolation_level=None
    )
    connection.text_factory = read_as_text
    try:
        if not has_tables(connection, str(path)):
            raise DatabaseRefusedError(f"{path}: is empty; no daemon has used it yet")
    except BaseException:
        connection.close()
        raise
    return connection


def read_requested(
    connection: sqlite3.Connection, since_ns: int, at_most: int
) -> list[StoredMessage]:
    """Return the latest points taken by a request of a command, oldest first."""
    rows = connection.execute(
        f"SELECT request, {COLUMNS} FROM messages INDEXED BY requested "
        "WHERE request IS NOT NULL AND time_ns >= ? ORDER BY number DESC LIMIT ?",
        (since_ns, at_most),
    ).fetchall()
    return [replace(stored_message(row[1:]), request=row[0]) for row in rows[::-1]]


def read_sessions(connection: sqlite3.Connection, at_most: int) -> list[StoredSession]:
    rows: list[tuple[Any, ...]] = connection.execute(
        "SELECT session, begun_ns, note, first_seq, last_seq FROM ("
        " SELECT rowid AS place, session, CAST(begun_ns AS INTEGER) AS begun_ns, note,"
        "  (SELECT min(seq) FROM messages m WHERE m.session = s.session) AS first_seq,"
        "  (SELECT max(seq) FROM messages m WHERE m.session = s.session) AS last_seq"
        " FROM sessions s ORDER BY place DESC LIMIT ?"
        ") WHERE first_seq IS NOT NULL ORDER BY place",
        (at_most,),
    ).fetchall()
    return [StoredSession(*row) for row in rows]


def counts_of(connection: sqlite3.Connection, session: str) -> tuple[int, int]:
    """Return how many points of a session there are, and how many the broker lacks."""
    points, unsent = connection.execute(
        "SELECT count(*), coalesce(sum(sent = 0), 0) FROM messages WHERE session = ?",
        (session,),
    ).fetchone()
    return points, unsent


def read_unsent(
    connection: sqlite3.Connection, after: int, at_most: int
) -> list[StoredMessage]:
    """Return messages that the broker lacks, in order, after a number."""
    rows = connection.execute(
        f"SELECT {COLUMNS} FROM messages INDEXED BY unsent "
        "WHERE sent = 0 AND number > ? ORDER BY number LIMIT ?",
        (after, at_most),
    )
    return [stored_message(row) for row in rows]


def stored_range(
    connection: sqlite3.Connection, session: str, from_seq: int, to_seq: int
) -> StoredRange:
    """Return figures of a session and of a range of its numbers."""
    first, last = connection.execute(
        "SELECT min(seq), max(seq) FROM messages WHERE session = ?", (session,)
    ).fetchone()
    (points,) = connection.execute(
        "SELECT count(*) FROM messages WHERE session = ? AND seq BETWEEN ? AND ? "
        f"AND sent <> {SET_ASIDE}",
        (session, from_seq, to_seq),
    ).fetchone()
    return StoredRange(points, first, last)


def read_messages(
    connection: sqlite3.Connection,
    session: str,
    from_seq: int,
    to_seq: int,
    at_most: int,
    *,
    without: int = SET_ASIDE,
) -> list[StoredMessage]:
    """Return the first messages of a range of a session, inclusive, in order.

    Those whose ``sent`` is ``without`` are left out.
    """
    rows = connection.execute(
        f"SELECT {COLUMNS} FROM messages WHERE session = ? AND seq BETWEEN ? AND ? "
        "AND sent <> ? ORDER BY seq LIMIT ?",
        (session, from_seq, to_seq, without, at_most),
    )
    return [stored_message(row) for row in rows]


def iter_messages(
    connection: sqlite3.Connection, session: str, from_seq: int, to_seq: int
) -> Iterator[StoredMessage]:
    """Yield messages of a range piece by piece, also those set aside."""
    ends = session, from_seq, to_seq
    while piece := read_messages(connection, *ends, PIECE, without=-1):
        yield from piece
        ends = session, piece[-1].seq + 1, to_seq


def block_id(block: Scan) -> str:
    return f"{block.scan}.{block.seq}"


@dataclass(frozen=True, slots=True)
class StoredScanRange:
    """Figures of a scan and of a range of its points.

    Attributes:
        session: in which it was made; None if nothing is stored.
        from_block: number of the first block of the range.
        blocks: number of blocks in the range.
        first_seq, last_seq: stored points of the whole scan.
        last_block: number of the last block stored.
        total: points of the scan; None without its last block.
    """

    session: str | None = None
    from_block: int = 0
    blocks: int = 0
    first_seq: int | None = None
    last_seq: int | None = None
    last_block: int = 0
    total: int | None = None


def stored_scan_range(
    connection: sqlite3.Connection, scan: str, from_seq: int, to_seq: int
) -> StoredScanRange:
    """Return figures of a scan and of a range of its points, inclusive."""
    execute = connection.execute
    held = stored_range(connection, scan, from_seq, to_seq)
    if held.first_seq is None or held.last_seq is None:
        return StoredScanRange()
    ((session,),) = execute("SELECT note FROM sessions WHERE session = ?", (scan,))
    # The block before may reach into the range: only it has its length.
    from_block = from_seq
    ((before,),) = execute(
        "SELECT max(seq) FROM messages WHERE session = ? AND seq <= ?", (scan, from_seq)
    )
    if before is not None:  # one without points has a number all the same
        block = _block(connection, scan, before)
        if block is not None and before + max(1, len(block.dtime_ns)) > from_seq:
            from_block = before
    last = _block(connection, scan, held.last_seq)
    end = held.last_seq if last is None else last.seq + len(last.dtime_ns)
    return StoredScanRange(
        session,
        from_block,
        stored_range(connection, scan, from_block, to_seq).points,
        held.first_seq,
        end - 1 if end > held.first_seq else None,
        held.last_seq,
        None if last is None else last.total,
    )


def _block(connection: sqlite3.Connection, scan: str, seq: int) -> Scan | None:
    """Return a block; None if it is damaged."""
    for message in read_messages(connection, scan, seq, seq, 1):
        if message.is_whole:
            return decode(Scan, message.payload, message.encoding)
    return None
