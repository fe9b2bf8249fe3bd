"""What can still be read of a damaged outbox: the points that the broker lacks."""

import contextlib
import sqlite3
from pathlib import Path
from urllib.parse import quote

from traverse.daemon.store.queries import COLUMNS, held
from traverse.daemon.store.records import Entry, Held
from traverse.daemon.store.scan_queries import block_id
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point, Scan

# By the index first: it leaves the pages alone that only hold what has been sent.
WAYS = ("INDEXED BY unsent", "NOT INDEXED")


def recover_unsent(path: Path) -> list[Entry]:
    """Messages that were not sent and can be read, in order, without repeats."""
    found: dict[str, Held] = {}
    begun: dict[str, tuple[int, str]] = {}
    address = f"file:{quote(str(path))}?mode=ro"
    with contextlib.closing(sqlite3.connect(address, uri=True)) as connection:
        with contextlib.suppress(sqlite3.Error):
            for session, begun_ns, note in connection.execute("SELECT * FROM sessions"):
                begun[session] = begun_ns, note
        for way in WAYS:
            with contextlib.suppress(sqlite3.Error, ValueError, TypeError):
                for row in connection.execute(
                    f"SELECT {COLUMNS} FROM messages {way} WHERE sent = 0 "
                    "ORDER BY number"
                ):
                    message = held(row)
                    if _is_whole(message):
                        found.setdefault(message.id, message)
    ordered = sorted(found.values(), key=lambda message: message.number)
    return [
        _entry(message, *begun.get(message.session, (0, ""))) for message in ordered
    ]


def _is_whole(message: Held) -> bool:
    """Whether the payload is the point, or the block of a scan, that the row says."""
    told = (message.session, message.seq, message.id)
    try:
        if message.topic.endswith("/scan"):
            block = decode(Scan, message.payload, message.encoding)
            return (block.scan, block.seq, block_id(block)) == told
        point = decode(Point, message.payload, message.encoding)
    except MessageError:
        return False
    return (point.session, point.seq, point.id) == told


def _entry(message: Held, begun_ns: int, note: str) -> Entry:
    return Entry(
        message.session,
        begun_ns,
        note,
        message.seq,
        message.id,
        message.time_ns,
        message.topic,
        message.encoding,
        message.payload,
    )
