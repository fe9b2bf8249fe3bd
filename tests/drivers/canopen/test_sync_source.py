"""The schedule of SYNCs, sent or received."""

from hypothesis import given, settings
from hypothesis import strategies as st

from traverse.drivers.canopen.sync_source import HostSchedule, ObservedSchedule


def test_host_syncs_keep_their_schedule_and_make_up_for_delays() -> None:
    schedule = HostSchedule(1000.0, 0)
    assert schedule.due_ns == 1_000_000
    assert schedule.take(1_050_000) == 1
    assert schedule.due_ns == 2_000_000
    assert schedule.take(4_700_000) == 1  # late: 3 and 4 follow, not too close
    assert schedule.due_ns == 5_500_000
    assert schedule.take(5_500_000) == 1
    assert schedule.due_ns == 6_300_000
    assert schedule.take(106_300_000) == 103  # 4 to 106 with one SYNC
    assert schedule.due_ns == 107_100_000


@settings(deadline=None)  # a busy computer stops for seconds
@given(st.lists(st.integers(1, 4), max_size=50), st.randoms(use_true_random=False))
def test_seen_syncs_are_numbered_by_time(steps: list[int], random: object) -> None:
    seen = ObservedSchedule(1000.0)
    assert seen.take(0) == 1
    at = 0
    for step in steps:
        at += step
        jitter = random.uniform(-200_000, 200_000)  # type: ignore[attr-defined]  # hypothesis' own Random
        assert seen.take(round(at * 1_000_100 + jitter)) == step


def test_seen_syncs_that_come_later_and_later_are_not_taken_for_missing_ones() -> None:
    # The broadcast manager of Linux: each a period, and a delay, after the last.
    seen = ObservedSchedule(1000.0)
    assert {seen.take(k * 1_100_000) for k in range(1000)} == {1}


def test_seen_syncs_of_another_master_are_counted_one_by_one() -> None:
    seen = ObservedSchedule(None)
    assert [seen.take(t) for t in (0, 10**9, 10**9 + 5)] == [1, 1, 1]
