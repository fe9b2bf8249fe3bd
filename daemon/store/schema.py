"""The outbox's tables, and whether a database is one that this version knows."""

import sqlite3

from traverse.daemon.store.records import StoreRefusedError

VERSION = 1
APPLICATION = 0x54525650  # "TRVP", so that `file` and people can tell whose it is

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
    """Make all tables, whole or not at all; numbers go on after ``last_number``."""
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
