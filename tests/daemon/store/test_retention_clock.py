"""By which time the age of points is counted."""

from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.store.outbox_entries import DAY_NS, NOW_NS, entries, rows
from tests.daemon.values import SetClock
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.retention_clock import CATCH_UP, FIRST_NS, RetentionClock

MINUTE_NS = 60 * 10**9


class Run:
    def __init__(self, utc_ns, *, is_believed=True):
        self.clock = SetClock()
        self.set_utc(utc_ns)
        self.retention = RetentionClock(self.clock)
        self.retention.is_believed = is_believed

    def set_utc(self, utc_ns):
        self.clock.offset_ns = utc_ns - self.clock.now_ns

    def after(self, passed_ns, stored_ns):
        self.clock.now_ns += passed_ns
        return self.retention.advanced(stored_ns)


def test_nothing_is_old_in_the_first_minutes_nor_in_doubt():
    run = Run(NOW_NS)
    assert run.after(FIRST_NS - 1, 0) == 0
    assert run.after(1, 0) == NOW_NS + FIRST_NS
    run.retention.is_believed = False
    assert run.after(MINUTE_NS, NOW_NS) == 0


def test_one_step_moves_it_by_a_day_in_a_minute():
    run = Run(NOW_NS)
    believed_ns = run.after(FIRST_NS, NOW_NS)
    run.set_utc(NOW_NS + 3000 * DAY_NS)
    later_ns = run.after(MINUTE_NS, believed_ns)
    assert later_ns == believed_ns + DAY_NS
    run.set_utc(NOW_NS)
    assert run.after(MINUTE_NS, later_ns) == later_ns  # and never back


@given(
    st.lists(
        st.tuples(
            st.integers(-4000 * DAY_NS, 4000 * DAY_NS), st.integers(0, 10 * MINUTE_NS)
        )
    )
)
def test_it_never_runs_back_nor_ahead_of_what_was_shown(steps):
    run = Run(NOW_NS)
    stored_ns, shown_ns, ran_ns = NOW_NS, NOW_NS, 0
    for step_ns, passed_ns in steps:
        run.clock.offset_ns += step_ns
        now_ns = run.after(passed_ns, stored_ns)
        ran_ns += passed_ns
        shown_ns = max(shown_ns, run.clock.to_utc_ns(run.clock.now_ns))
        if now_ns:
            assert stored_ns <= now_ns <= shown_ns
            assert now_ns - NOW_NS <= CATCH_UP * ran_ns
            stored_ns = now_ns


def test_the_store_keeps_it_over_restarts(tmp_path):
    path = tmp_path / "outbox.db"
    store = MessageDatabase(path)
    assert store.believed_ns(lambda stored_ns: 0) == 0
    assert store.believed_ns(lambda stored_ns: NOW_NS + stored_ns) == NOW_NS
    store.close()
    store = MessageDatabase(path)
    assert store.believed_ns(lambda stored_ns: stored_ns) == NOW_NS
    store.add(entries("old", 3, time_ns=NOW_NS - 100 * DAY_NS))
    store.mark_sent([(1, 3)])
    ahead = Run(NOW_NS + 4000 * DAY_NS)  # a start with a clock that is years ahead
    for _ in range(20):
        before_ns = store.believed_ns(lambda s: ahead.after(MINUTE_NS, s))
        store.delete_old(
            before_ns=max(0, before_ns - 150 * DAY_NS),
            keep_bytes=10**12,
            running="new",
            at_most=100,
        )
    store.close()
    assert len(rows(path)) == 3
