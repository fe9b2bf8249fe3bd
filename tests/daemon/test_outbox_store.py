"""What the database of the outbox keeps, forgets and refuses."""

import sqlite3
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.outbox_reading import (
    all_messages_of,
    counts_of,
    extent_of,
    messages_of,
    open_to_read,
    sessions_of,
    unsent_of,
)
from daemon.outbox_store import OutboxStore
from daemon.outbox_trouble import set_aside, trouble_of
from daemon.outbox_values import Extent, HeldSession, OutboxRefusedError
from tests.daemon.outbox_bench import DAY_NS, NOW_NS, entries, entry, execute, rows


@pytest.fixture
def path(tmp_path):
    return tmp_path / "outbox.db"


@pytest.fixture
def store(path):
    opened = OutboxStore(path)
    yield opened
    opened.close()


def forget(store, *, before_ns=0, keep_bytes=10**12, running="", at_most=1000):
    return store.forget(
        before_ns=before_ns, keep_bytes=keep_bytes, running=running, at_most=at_most
    )


def test_what_was_added_is_there_as_it_was_in_order(store, path):
    assert store.add(entries("a", 2)) == [1, 2]
    assert store.add([entry("b", 0, encoding="json")]) == [3]
    found = unsent_of(store.connection, 0, 10)
    assert [(m.number, m.session, m.seq, m.id) for m in found] == [
        (1, "a", 0, "a-0"),
        (2, "a", 1, "a-1"),
        (3, "b", 0, "b-0"),
    ]
    assert found[2].payload == b"point 0"
    assert (found[2].encoding, found[2].topic) == ("json", "traverse/arm/point")
    assert found[0].time_ns == NOW_NS
    assert rows(path) == [("a", 0, 0), ("a", 1, 0), ("b", 0, 0)]
    assert unsent_of(store.connection, 1, 1) == found[1:2]


def test_every_commit_of_points_is_synced_and_marks_are_not(store):
    (mode,) = store.connection.execute("PRAGMA journal_mode").fetchone()
    (level,) = store.connection.execute("PRAGMA synchronous").fetchone()
    assert (mode, level) == ("wal", 2)  # 2 is FULL
    store.add(entries("a", 1))
    store.mark_sent([(1, 1)])
    assert store.connection.execute("PRAGMA synchronous").fetchone() == (2,)


def test_a_number_is_kept_once_and_a_failed_group_leaves_nothing(store, path):
    store.add(entries("a", 2))
    with pytest.raises(sqlite3.IntegrityError):
        store.add([entry("a", 2), entry("a", 1)])
    assert rows(path) == [("a", 0, 0), ("a", 1, 0)]
    assert store.add([entry("a", 2)]) == [3]
    assert store.figures().points == 3


def test_marked_ones_are_not_unsent_any_more(store):
    store.add(entries("a", 6))
    store.mark_sent([(1, 2), (4, 4), (90, 99)])
    store.mark_sent([(1, 2)])
    assert [m.number for m in unsent_of(store.connection, 0, 10)] == [3, 5, 6]
    figures = store.figures()
    assert (figures.points, figures.unsent) == (6, 3)
    assert figures.oldest_unsent_ns == NOW_NS
    store.mark_sent([(3, 6)])
    assert store.figures().oldest_unsent_ns is None


def test_opened_again_it_counts_what_there_is_and_numbers_go_on(store, path):
    store.add(entries("a", 3))
    store.mark_sent([(1, 1)])
    store.close()
    again = OutboxStore(path)
    figures = again.figures()
    assert (figures.points, figures.unsent, again.last_number) == (3, 2, 3)
    assert again.add(entries("b", 1)) == [4]
    again.close()


def test_a_new_one_numbers_after_the_one_that_it_replaces(path):
    store = OutboxStore(path, last_number=41)
    assert store.add(entries("a", 2)) == [42, 43]
    store.close()


def test_extents_and_ranges_have_their_ends(store):
    store.add(entries("a", 10, first=5))
    assert extent_of(store.connection, "a", 7, 9) == Extent(3, 5, 14)
    assert extent_of(store.connection, "a", 0, 2**53 - 1) == Extent(10, 5, 14)
    assert extent_of(store.connection, "a", 15, 20) == Extent(0, 5, 14)
    assert extent_of(store.connection, "nobody", 0, 9) == Extent(0, None, None)
    found = messages_of(store.connection, "a", 6, 12, 4)
    assert [m.seq for m in found] == [6, 7, 8, 9]


def test_sessions_are_listed_oldest_first_the_latest_of_them(store):
    for session in "cab":
        store.add(entries(session, 3))
    store.mark_sent([(4, 5)])
    assert sessions_of(store.connection, 2) == [
        HeldSession("a", NOW_NS, "note of a", 0, 2),
        HeldSession("b", NOW_NS, "note of b", 0, 2),
    ]
    assert counts_of(store.connection, "a") == (3, 1)
    assert counts_of(store.connection, "nobody") == (0, 0)


def test_a_reader_beside_reads_all_in_pieces_and_writes_nothing(store, path):
    store.add(entries("a", 1203))
    reader = open_to_read(path)
    assert [m.seq for m in all_messages_of(reader, "a", 1, 2**53)] == [*range(1, 1203)]
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        reader.execute("DELETE FROM messages")
    reader.close()


# -- forgetting ---------------------------------------------------------------


def test_what_is_old_and_sent_goes_with_its_session(store, path):
    store.add(entries("a", 3, time_ns=NOW_NS - 100 * DAY_NS))
    store.add(entries("b", 3))
    store.mark_sent([(1, 6)])
    assert forget(store, before_ns=NOW_NS - 90 * DAY_NS) == 3
    assert rows(path) == [("b", 0, 1), ("b", 1, 1), ("b", 2, 1)]
    assert [s.session for s in sessions_of(store.connection, 9)] == ["b"]
    assert execute(path, "SELECT session FROM sessions") == [("b",)]
    assert forget(store, before_ns=NOW_NS - 90 * DAY_NS) == 0


def test_what_the_broker_does_not_have_stays_however_old_and_many(store):
    store.add(entries("a", 300, time_ns=0, payload=bytes(10_000)))
    store.mark_sent([(1, 100)])
    assert forget(store, before_ns=NOW_NS, keep_bytes=0) == 100
    assert forget(store, before_ns=NOW_NS, keep_bytes=0) == 0
    assert store.figures().points == store.figures().unsent == 200
    store.mark_sent([(150, 160)])  # behind some that the broker does not have
    assert forget(store, before_ns=NOW_NS, keep_bytes=0) == 0


def test_the_running_session_is_not_forgotten_for_its_age(store):
    """A computer without a clock of its own begins in 1970."""
    store.add(entries("a", 3, time_ns=5))
    store.mark_sent([(1, 3)])
    assert forget(store, before_ns=NOW_NS, running="a") == 0
    assert forget(store, before_ns=NOW_NS, running="b") == 3


def test_points_of_a_wrong_clock_do_not_take_those_before_them_along(store):
    store.add([entry("a", 0), entry("a", 1, time_ns=5), entry("a", 2)])
    store.mark_sent([(1, 3)])
    assert forget(store, before_ns=NOW_NS - DAY_NS) == 0


def test_beyond_its_size_the_oldest_go_in_small_steps_and_the_file_shrinks(store):
    store.add(entries("a", 400, payload=bytes(4000)))
    store.mark_sent([(1, 400)])
    full_bytes = store.figures().size_bytes
    assert full_bytes > 400 * 4000
    steps = 0
    while forget(store, keep_bytes=800_000, running="a", at_most=50):
        steps += 1
    assert 4 <= steps <= 6
    for _ in range(5):
        store.give_back()
    assert store.figures().size_bytes < 0.7 * full_bytes
    left = store.figures().points
    assert [m.seq for m in messages_of(store.connection, "a", 0, 999, 999)] == [
        *range(400 - left, 400)
    ]


# -- files that cannot be used -------------------------------------------------


def test_a_newer_version_is_refused_with_what_to_do(store, path):
    store.close()
    execute(path, "PRAGMA user_version = 2")
    with pytest.raises(
        OutboxRefusedError, match=r"version 2.*knows version 1.*install"
    ):
        OutboxStore(path)


def test_a_database_of_another_program_is_left_alone(path):
    execute(path, "CREATE TABLE songs (title TEXT)")
    with pytest.raises(OutboxRefusedError, match="another program"):
        OutboxStore(path)
    with pytest.raises(OutboxRefusedError, match="another program"):
        open_to_read(path)


def test_to_read_needs_a_file_that_a_daemon_has_used(path):
    with pytest.raises(OutboxRefusedError, match=r"no such file.*--db"):
        open_to_read(path)
    path.write_bytes(b"")
    with pytest.raises(OutboxRefusedError, match="no daemon has used it"):
        open_to_read(path)


@pytest.mark.parametrize("where", [0, 100, 4096 + 3])
def test_damage_is_noticed_at_the_start(store, path, where):
    store.add(entries("a", 50))
    store.close()
    content = bytearray(path.read_bytes())
    content[where : where + 64] = b"\xa5" * 64
    path.write_bytes(content)
    with pytest.raises(sqlite3.DatabaseError) as caught:
        OutboxStore(path)
    assert caught.value.sqlite_errorcode & 0xFF in (11, 26)


def test_set_aside_keeps_all_files_under_names_of_their_own(store, path):
    store.add(entries("a", 1))
    first = set_aside(path)
    assert first.name.startswith("outbox.db.corrupt-20")
    assert not path.exists()
    assert (first.parent / f"{first.name}-wal").exists()
    path.write_bytes(b"another")
    assert set_aside(path) != first


def test_a_file_that_was_replaced_is_noticed(store, path):
    assert store.is_in_place
    path.rename(path.with_suffix(".old"))
    assert not store.is_in_place
    path.write_bytes(b"")
    assert not store.is_in_place


def test_a_full_disk_is_told_and_is_over_when_there_is_room(store, path):
    store.add(entries("a", 1))
    (pages,) = store.connection.execute("PRAGMA page_count").fetchone()
    store.connection.execute(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(sqlite3.OperationalError, match="full") as caught:
        store.add(entries("a", 200, first=1))
    trouble = trouble_of(caught.value, path)
    assert "the disk is full" in trouble.text
    assert str(path.parent) in trouble.remedy
    with pytest.raises(sqlite3.OperationalError, match="full"):
        store.try_room()
    store.connection.execute("PRAGMA max_page_count = 100000")
    store.try_room()
    assert store.add(entries("a", 1, first=1)) == [2]
    assert rows(path) == [("a", 0, 0), ("a", 1, 0)]


# -- crashes ------------------------------------------------------------------

WRITER = """
import os, sys
from pathlib import Path
from daemon.outbox_store import OutboxStore
from tests.daemon.outbox_bench import entries
store = OutboxStore(Path(sys.argv[1]))
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
    store = OutboxStore(path)
    assert [m.seq for m in unsent_of(store.connection, 0, 99)] == [*range(36, 40)]
    assert store.figures().points == 40
    store.close()


@settings(max_examples=30, deadline=None)
@given(cut=st.integers(0, 60_000))
def test_a_log_that_is_cut_anywhere_leaves_whole_groups_in_order(tmp_path_factory, cut):
    """What a power cut leaves of a disk that writes in order."""
    folder = tmp_path_factory.mktemp("cut")
    path = folder / "outbox.db"
    store = OutboxStore(path)
    for first in range(0, 40, 4):
        store.add(entries("a", 4, first=first))
    torn = folder / "torn.db"
    torn.write_bytes(path.read_bytes())
    log = (folder / "outbox.db-wal").read_bytes()
    (folder / "torn.db-wal").write_bytes(log[: min(cut, len(log))])
    store.close()
    try:
        again = OutboxStore(torn)
    except sqlite3.DatabaseError:
        return  # before its tables were there
    seqs = [m.seq for m in unsent_of(again.connection, 0, 99)]
    again.close()
    assert seqs == [*range(len(seqs))]
    assert len(seqs) % 4 == 0
