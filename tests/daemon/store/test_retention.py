from tests.daemon.store.outbox_entries import (
    DAY_NS,
    NOW_NS,
    entries,
    entry,
    execute,
    rows,
)
from traverse.daemon.store.queries import read_messages, read_sessions


def forget(store, *, before_ns=0, keep_bytes=10**12, running="", at_most=1000):
    return store.delete_old(
        before_ns=before_ns, keep_bytes=keep_bytes, running=running, at_most=at_most
    )


def test_what_is_old_and_sent_goes_with_its_session(store, path):
    store.add(entries("a", 3, time_ns=NOW_NS - 100 * DAY_NS))
    store.add(entries("b", 3))
    store.mark_sent([(1, 6)])
    assert forget(store, before_ns=NOW_NS - 90 * DAY_NS) == 3
    assert rows(path) == [("b", 0, 1), ("b", 1, 1), ("b", 2, 1)]
    assert [s.session for s in read_sessions(store.connection, 9)] == ["b"]
    assert execute(path, "SELECT session FROM sessions") == [("b",)]
    assert forget(store, before_ns=NOW_NS - 90 * DAY_NS) == 0


def test_what_the_broker_does_not_have_stays_however_old_and_many(store):
    store.add(entries("a", 300, time_ns=0, payload=bytes(10_000)))
    store.mark_sent([(1, 100)])
    assert forget(store, before_ns=NOW_NS, keep_bytes=0) == 100
    assert forget(store, before_ns=NOW_NS, keep_bytes=0) == 0
    assert store.statistics().points == store.statistics().unsent == 200
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
    full_bytes = store.statistics().size_bytes
    assert full_bytes > 400 * 4000
    steps = 0
    while forget(store, keep_bytes=800_000, running="a", at_most=50):
        steps += 1
    assert 4 <= steps <= 6
    for _ in range(5):
        store.trim_file()
    assert store.statistics().size_bytes < 0.7 * full_bytes
    left = store.statistics().points
    assert [m.seq for m in read_messages(store.connection, "a", 0, 999, 999)] == [
        *range(400 - left, 400)
    ]
