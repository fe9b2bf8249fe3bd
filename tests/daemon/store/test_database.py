import sqlite3

import pytest

from tests.daemon.store.outbox_entries import NOW_NS, entries, entry, rows
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import (
    counts_of,
    iter_messages,
    open_read_only,
    read_messages,
    read_sessions,
    read_unsent,
    stored_range,
)
from traverse.daemon.store.records import StoredRange, StoredSession


def test_what_was_added_is_there_as_it_was_in_order(store, path):
    assert store.add(entries("a", 2)) == [1, 2]
    assert store.add([entry("b", 0, encoding="json")]) == [3]
    messages = read_unsent(store.connection, 0, 10)
    assert [(m.number, m.session, m.seq, m.id) for m in messages] == [
        (1, "a", 0, "a-0"),
        (2, "a", 1, "a-1"),
        (3, "b", 0, "b-0"),
    ]
    assert messages[2].payload == b"point 0"
    assert (messages[2].encoding, messages[2].topic) == ("json", "traverse/arm/point")
    assert messages[0].time_ns == NOW_NS
    assert rows(path) == [("a", 0, 0), ("a", 1, 0), ("b", 0, 0)]
    assert read_unsent(store.connection, 1, 1) == messages[1:2]


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
    assert store.statistics().points == 3


def test_marked_ones_are_not_unsent_any_more(store):
    store.add(entries("a", 6))
    store.mark_sent([(1, 2), (4, 4), (90, 99)])
    store.mark_sent([(1, 2)])
    assert [m.number for m in read_unsent(store.connection, 0, 10)] == [3, 5, 6]
    figures = store.statistics()
    assert (figures.points, figures.unsent) == (6, 3)
    assert figures.oldest_unsent_ns == NOW_NS
    store.mark_sent([(3, 6)])
    assert store.statistics().oldest_unsent_ns is None


def test_opened_again_it_counts_what_there_is_and_numbers_continue(store, path):
    store.add(entries("a", 3))
    store.mark_sent([(1, 1)])
    store.close()
    again = MessageDatabase(path)
    figures = again.statistics()
    assert (figures.points, figures.unsent, again.last_number) == (3, 2, 3)
    assert again.add(entries("b", 1)) == [4]
    again.close()


def test_a_new_one_numbers_after_the_one_that_it_replaces(path):
    store = MessageDatabase(path, last_number=41)
    assert store.add(entries("a", 2)) == [42, 43]
    store.close()


def test_extents_and_ranges_have_their_ends(store):
    store.add(entries("a", 10, first=5))
    assert stored_range(store.connection, "a", 7, 9) == StoredRange(3, 5, 14)
    assert stored_range(store.connection, "a", 0, 2**53 - 1) == StoredRange(10, 5, 14)
    assert stored_range(store.connection, "a", 15, 20) == StoredRange(0, 5, 14)
    assert stored_range(store.connection, "nobody", 0, 9) == StoredRange(0, None, None)
    messages = read_messages(store.connection, "a", 6, 12, 4)
    assert [m.seq for m in messages] == [6, 7, 8, 9]


def test_sessions_are_listed_oldest_first_the_latest_of_them(store):
    for session in "cab":
        store.add(entries(session, 3))
    store.mark_sent([(4, 5)])
    assert read_sessions(store.connection, 2) == [
        StoredSession("a", NOW_NS, "note of a", 0, 2),
        StoredSession("b", NOW_NS, "note of b", 0, 2),
    ]
    assert counts_of(store.connection, "a") == (3, 1)
    assert counts_of(store.connection, "nobody") == (0, 0)


def test_a_reader_beside_reads_all_in_pieces_and_writes_nothing(store, path):
    store.add(entries("a", 1203))
    reader = open_read_only(path)
    assert [m.seq for m in iter_messages(reader, "a", 1, 2**53)] == [*range(1, 1203)]
    with pytest.raises(sqlite3.OperationalError, match="readonly"):
        reader.execute("DELETE FROM messages")
    reader.close()
