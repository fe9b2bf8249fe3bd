"""Files of the outbox that are damaged, full, foreign or cut off by a crash."""

import sqlite3
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.store.outbox_entries import entries, execute, rows
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import open_read_only, read_unsent
from traverse.daemon.store.records import DatabaseRefusedError
from traverse.daemon.store.recovery import move_aside, storage_error_of


@pytest.mark.parametrize("version", [2, 4])
def test_another_version_is_refused_with_what_to_do(store, path, version):
    store.close()
    execute(path, f"PRAGMA user_version = {version}")
    with pytest.raises(
        DatabaseRefusedError, match=rf"version {version}.*knows version 3.*install"
    ):
        MessageDatabase(path)


def test_a_database_of_another_program_is_left_alone(path):
    execute(path, "CREATE TABLE songs (title TEXT)")
    with pytest.raises(DatabaseRefusedError, match="another program"):
        MessageDatabase(path)
    with pytest.raises(DatabaseRefusedError, match="another program"):
        open_read_only(path)


def test_to_read_needs_a_file_that_a_daemon_has_used(path):
    with pytest.raises(DatabaseRefusedError, match=r"no such file.*--db"):
        open_read_only(path)
    path.write_bytes(b"")
    with pytest.raises(DatabaseRefusedError, match="no daemon has used it"):
        open_read_only(path)


@pytest.mark.parametrize("where", [0, 100, 4096 + 3])
def test_damage_is_noticed_at_the_start(store, path, where):
    store.add(entries("a", 50))
    store.close()
    content = bytearray(path.read_bytes())
    content[where : where + 64] = b"\xa5" * 64
    path.write_bytes(content)
    with pytest.raises(sqlite3.DatabaseError) as caught:
        MessageDatabase(path)
    assert caught.value.sqlite_errorcode & 0xFF in (11, 26)


def test_set_aside_keeps_all_files_under_names_of_their_own(store, path):
    store.add(entries("a", 1))
    first = move_aside(path)
    assert first.name.startswith("outbox.db.corrupt-20")
    assert not path.exists()
    assert (first.parent / f"{first.name}-wal").exists()
    path.write_bytes(b"another")
    assert move_aside(path) != first


def test_a_file_that_was_replaced_is_noticed(store, path):
    assert store.is_file_unchanged
    path.rename(path.with_suffix(".old"))
    assert not store.is_file_unchanged
    path.write_bytes(b"")
    assert not store.is_file_unchanged


def test_a_full_disk_is_reported_and_is_over_when_there_is_room(store, path):
    store.add(entries("a", 1))
    (pages,) = store.connection.execute("PRAGMA page_count").fetchone()
    store.connection.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(sqlite3.OperationalError, match="full") as caught:
        store.add(entries("a", 200, first=1))
    trouble = storage_error_of(caught.value, path)
    assert "the disk is full" in trouble.text
    assert str(path.parent) in trouble.remedy
    with pytest.raises(sqlite3.OperationalError, match="full"):
        store.check_space()
    store.connection.execute("PRAGMA max_page_count = 100000")
    store.check_space()
    assert store.add(entries("a", 1, first=1)) == [2]
    assert rows(path) == [("a", 0, 0), ("a", 1, 0)]


WRITER = """
import os, sys
from pathlib import Path
from tests.daemon.store.outbox_entries import entries
from traverse.daemon.store.database import MessageDatabase
store = MessageDatabase(Path(sys.argv[1]))
for first in range(0, 40, 4):
    store.add(entries("a", 4, first=first))
    store.mark_sent([(1, first)])
print(store.last_number, flush=True)
store.connection.execute("BEGIN IMMEDIATE")
store.connection.execute("DELETE FROM messages")
os.kill(os.getpid(), 9)
"""


def test_a_killed_process_leaves_all_that_was_committed_and_nothing_else(path):
    done = subprocess.run(
        [sys.executable, "-c", WRITER, str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (-9, "40\n")
    store = MessageDatabase(path)
    assert [m.seq for m in read_unsent(store.connection, 0, 99)] == [*range(36, 40)]
    assert store.statistics().points == 40
    store.close()


@settings(max_examples=30)
@given(cut=st.integers(0, 60_000))
def test_a_log_that_is_cut_anywhere_leaves_whole_groups_in_order(tmp_path_factory, cut):
    """What a power cut leaves of a disk that writes in order."""
    folder = tmp_path_factory.mktemp("cut")
    path = folder / "outbox.db"
    store = MessageDatabase(path)
    for first in range(0, 40, 4):
        store.add(entries("a", 4, first=first))
    torn = folder / "torn.db"
    torn.write_bytes(path.read_bytes())
    log = (folder / "outbox.db-wal").read_bytes()
    (folder / "torn.db-wal").write_bytes(log[: min(cut, len(log))])
    store.close()
    try:
        again = MessageDatabase(torn)
    except sqlite3.DatabaseError:
        return  # before its tables were there
    seqs = [m.seq for m in read_unsent(again.connection, 0, 99)]
    again.close()
    assert seqs == [*range(len(seqs))]
    assert len(seqs) % 4 == 0
