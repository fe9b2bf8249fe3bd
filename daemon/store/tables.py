"""Tables of a store, and which databases have them."""

import re
import sqlite3

from traverse.daemon.store.records import DatabaseRefusedError

VERSION = 3
SET_ASIDE = 2  # `sent` of a damaged message
APPLICATION = 0x54525650  # "TRVP", so that `file` and people can recognise it

COLUMNS = "number, session, seq, id, time_ns, topic, encoding, payload, crc, request"
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
    crc INTEGER NOT NULL,
    request TEXT,
    UNIQUE (session, seq)
);
CREATE INDEX unsent ON messages (number) WHERE sent = 0;
CREATE INDEX requested ON messages (number) WHERE request IS NOT NULL;
CREATE TABLE room (only INTEGER PRIMARY KEY, filler BLOB NOT NULL);
"""

BELIEVED = (
    "CREATE TABLE IF NOT EXISTS believed "
    "(only INTEGER PRIMARY KEY, utc_ns INTEGER NOT NULL)"
)


def read_as_text(value: bytes) -> str:
    """Decode text of SQLite; a damaged byte must not stop a query."""
    return value.decode("utf-8", "replace")


def has_tables(connection: sqlite3.Connection, name: str) -> bool:
    """Return whether it is an outbox; False of a new database.

    Raises:
        DatabaseRefusedError: it is of another version, or not an outbox.
        sqlite3.Error: it cannot be read.
    """
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if version == 0 and application == 0 and not names:
        return False
    if application != APPLICATION:
        raise DatabaseRefusedError(
            f"{name}: is a database of another program (application_id "
            f"{application:#x}, expected {APPLICATION:#x}); move it away, or name "
            "another state folder"
        )
    if version != VERSION:
        raise DatabaseRefusedError(
            f"{name}: has tables of version {version}, this program knows version "
            f"{VERSION}; install the version of traverse that wrote it, or move the "
            "file away: its points can be sent and exported by that version only"
        )
    if lacking := set(re.findall(r"CREATE \w+ (\w+)", TABLES)) - names:
        error = sqlite3.DatabaseError(f"it lacks {', '.join(sorted(lacking))}")
        error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
        raise error
    return True


def create_tables(connection: sqlite3.Connection) -> None:
    connection.execute("BEGIN IMMEDIATE")
    for statement in TABLES.split(";"):
        if statement.strip():
            connection.execute(statement)
    connection.execute("INSERT INTO sqlite_sequence (name, seq) VALUES ('messages', 0)")
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")
    connection.execute("COMMIT")
