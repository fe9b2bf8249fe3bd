"""What is read from the scans on the disk: a database like the outbox's, with blocks.

A block is a message with the scan in place of the session, and with the number of its
first point. The note of the "session" is the real session's name.
"""

import sqlite3
from dataclasses import dataclass

from traverse.daemon.store.queries import read_messages
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Scan


def block_id(block: Scan) -> str:
    """A name that no other block has."""
    return f"{block.scan}.{block.seq}"


@dataclass(frozen=True, slots=True)
class StoredScanRange:
    """What there is of a scan, and of a range of its points.

    Attributes:
        session: in which it was made; None where there is nothing of it.
        from_block: number of the block in which the range begins.
        blocks: how many the range touches.
        first_seq, last_seq: points held of the whole scan.
        last_block: number of the last block held.
        total: points of the scan; None while its last block is not here.
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
    """What there is of a scan, and of the range of its points, ends included."""
    execute = connection.execute
    first, last = execute(
        "SELECT min(seq), max(seq) FROM messages WHERE session = ?", (scan,)
    ).fetchone()
    if first is None:
        return StoredScanRange()
    ((session,),) = execute("SELECT note FROM sessions WHERE session = ?", (scan,))
    # The block before may reach into the range: how long it is, only it tells.
    from_block = from_seq
    ((before,),) = execute(
        "SELECT max(seq) FROM messages WHERE session = ? AND seq <= ?", (scan, from_seq)
    )
    if before is not None and _end_of(connection, scan, before) > from_seq:
        from_block = before
    ((blocks,),) = execute(
        "SELECT count(*) FROM messages WHERE session = ? AND seq BETWEEN ? AND ?",
        (scan, from_block, to_seq),
    )
    block = _block(connection, scan, last)
    end = last + len(block.dtime_ns)
    return StoredScanRange(
        session,
        from_block,
        blocks,
        first,
        end - 1 if end > first else None,
        last,
        block.total,
    )


def _end_of(connection: sqlite3.Connection, scan: str, seq: int) -> int:
    """The number after the last point of a block; after itself where it has none."""
    return seq + max(1, len(_block(connection, scan, seq).dtime_ns))


def _block(connection: sqlite3.Connection, scan: str, seq: int) -> Scan:
    (held,) = read_messages(connection, scan, seq, seq, 1)
    return decode(Scan, held.payload, held.encoding)
