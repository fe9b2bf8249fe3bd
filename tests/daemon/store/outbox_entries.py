"""Entries for outboxes, and a file system as full as a test sets it."""

import sqlite3

from traverse.daemon.store.records import NewMessage

DAY_NS = 86_400 * 10**9
NOW_NS = 1_800_000_000 * 10**9


def entry(session="s", seq=0, *, time_ns=NOW_NS, payload=b"point", encoding="msgpack"):
    return NewMessage(
        session,
        seq,
        f"{session}-{seq}",
        time_ns,
        "traverse/arm/point",
        encoding,
        payload + b" %d" % seq,
        NOW_NS,
        f"note of {session}",
    )


def entries(session, n, first=0, **options):
    return [entry(session, seq, **options) for seq in range(first, first + n)]


def rows(path):
    """(session, seq, sent) of all messages, as another program reads them."""
    connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        return connection.execute(
            "SELECT session, seq, sent FROM messages ORDER BY number"
        ).fetchall()
    finally:
        connection.close()


TABLES = ("messages", "room")


def fill_disk(path, *tables):
    """Refuse rows of these tables, or of all, until `make_room`."""
    for table in tables or TABLES:
        execute(
            path,
            f"CREATE TRIGGER {table}_full BEFORE INSERT ON {table} "
            "BEGIN SELECT RAISE(FAIL, 'database or disk is full'); END",
        )


def make_room(path):
    for table in TABLES:
        execute(path, f"DROP TRIGGER IF EXISTS {table}_full")


def execute(path, text, *values):
    connection = sqlite3.connect(path)
    try:
        with connection:
            return connection.execute(text, values).fetchall()
    finally:
        connection.close()
