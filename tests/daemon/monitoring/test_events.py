import pytest

from tests.daemon.values import SetClock
from traverse.daemon.monitoring.events import (
    CALM_NS,
    MAX_CHANGES,
    MAX_DISTINCT,
    MAX_KINDS,
    QUIET_NS,
    EventLog,
)


class Bench:
    def __init__(self) -> None:
        self.clock = SetClock()
        self.occurrences = []
        self.log = EventLog(self.clock, self.occurrences.append)

    def lost(self, count=1, source="base"):
        text = f"{count} lost"
        self.log.report("warning", "device.lost", text, source=source, count=count)


@pytest.fixture
def bench():
    return Bench()


def test_the_first_is_reported_at_once_and_repetitions_together(bench):
    start_ns = bench.clock.now_ns
    bench.lost()
    assert [occurrence.count for occurrence in bench.occurrences] == [1]
    for k in range(1, 4):
        bench.clock.now_ns = start_ns + k * 100
        bench.lost(count=k)
        bench.log.flush()
    assert len(bench.occurrences) == 1
    bench.clock.now_ns = start_ns + QUIET_NS
    bench.log.flush()
    joined = bench.occurrences[1]
    assert (joined.count, joined.text) == (6, "3 lost")
    assert (joined.first_ns, joined.last_ns) == (start_ns + 100, start_ns + 300)
    bench.log.flush()
    assert len(bench.occurrences) == 2


def test_different_sources_do_not_wait_for_each_other(bench):
    bench.lost(source="base")
    bench.lost(source="wrist")
    assert [occurrence.source for occurrence in bench.occurrences] == ["base", "wrist"]


def test_after_a_quiet_time_the_next_is_reported_at_once(bench):
    bench.lost()
    bench.clock.now_ns += QUIET_NS
    bench.lost()
    assert len(bench.occurrences) == 2


def test_buttons_are_reported_one_by_one(bench):
    for _ in range(5):
        bench.log.report("info", "button.pressed", "", source="base/0", distinct=True)
    assert [occurrence.count for occurrence in bench.occurrences] == [1] * 5


def test_a_broken_button_does_not_flood(bench):
    def press(n):
        for _ in range(n):
            bench.log.report(
                "info", "button.pressed", "", source="base/0", distinct=True
            )

    press(500)
    assert [occurrence.count for occurrence in bench.occurrences] == [1] * MAX_DISTINCT
    bench.clock.now_ns += QUIET_NS
    press(3)
    held = 500 - MAX_DISTINCT
    assert [occurrence.count for occurrence in bench.occurrences[MAX_DISTINCT:]] == [
        held,
        1,
        1,
        1,
    ]
    press(MAX_DISTINCT)
    bench.clock.now_ns += QUIET_NS
    bench.log.flush()
    assert (
        sum(occurrence.count for occurrence in bench.occurrences) == 503 + MAX_DISTINCT
    )


def test_a_lasting_condition_is_raised_once_and_cleared_once(bench):
    change = bench.log.change
    change(False, "error", "broker.lost", "there", source="broker")
    assert bench.occurrences == []  # it was never raised
    for _ in range(3):
        change(True, "error", "broker.lost", "gone", source="broker", remedy="start it")
    for _ in range(3):
        change(False, "error", "broker.lost", "there", source="broker")
    assert [(e.active, e.severity, e.text) for e in bench.occurrences] == [
        (True, "error", "gone"),
        (False, "info", "there"),
    ]


def flap(bench, times):
    """A condition that is raised and cleared; ends as it began."""
    for k in range(2 * times):
        bench.clock.now_ns += 1_000_000
        active = k % 2 == 0
        bench.log.change(active, "error", "alarm.7", f"change {k}", source="base/1")
        bench.log.flush()


def test_a_condition_that_comes_and_goes_does_not_flood(bench):
    flap(bench, 2500)  # for five seconds
    n_reported = len(bench.occurrences)
    assert MAX_CHANGES <= n_reported <= MAX_CHANGES + 5
    bench.clock.now_ns += QUIET_NS
    bench.log.flush()
    last = bench.occurrences[-1]
    assert (last.active, last.severity, last.text) == (False, "info", "change 4999")
    assert sum(occurrence.count for occurrence in bench.occurrences) == 5000
    bench.log.flush()
    assert len(bench.occurrences) == n_reported + 1


def test_a_condition_that_has_calmed_down_is_reported_at_once_again(bench):
    flap(bench, 100)
    bench.clock.now_ns += CALM_NS
    bench.log.flush()
    bench.occurrences.clear()
    flap(bench, 1)
    assert [
        (occurrence.active, occurrence.count) for occurrence in bench.occurrences
    ] == [
        (True, 1),
        (False, 1),
    ]


def test_what_is_held_back_when_the_daemon_ends_is_reported(bench):
    flap(bench, 10)
    bench.lost()
    bench.lost(count=4)
    bench.log.flush()
    before = len(bench.occurrences)
    bench.log.flush(at_once=True)
    flapping, lost = sorted(
        bench.occurrences[before:], key=lambda occurrence: occurrence.code
    )
    assert (flapping.count, flapping.active) == (20 - MAX_CHANGES, False)
    assert (lost.count, lost.code) == (4, "device.lost")
    bench.log.flush(at_once=True)
    assert len(bench.occurrences) == before + 2


def test_endlessly_many_kinds_take_no_endless_memory(bench):
    for k in range(5 * MAX_KINDS):
        bench.log.change(True, "error", f"alarm.{k}", "", source="base")
        bench.log.report("warning", f"device.{k}", "", source="base")
    assert len(bench.occurrences) == 10 * MAX_KINDS
    sizes = (bench.log._told_ns, bench.log._held, bench.log._active)
    assert all(len(kept) <= MAX_KINDS for kept in sizes)


def test_events_are_logged_with_their_remedy(bench, caplog):
    bench.log.report("error", "some.thing", "text", source="x", remedy="do this")
    assert "some.thing: text; do this" in caplog.text


def test_what_lasts_is_known_until_it_ends(bench):
    changes = []
    log = EventLog(
        bench.clock, bench.occurrences.append, changed=lambda: changes.append(1)
    )
    log.report("warning", "device.noise", "a click", source="base")
    assert (log.active, changes) == ((), [])
    log.change(True, "error", "device.lost", "gone", source="base", remedy="look")
    log.change(True, "warning", "limit.temperature", "warm", source="quality")
    assert [occurrence.code for occurrence in log.active] == [
        "device.lost",
        "limit.temperature",
    ]
    assert log.active[0].remedy == "look"
    log.change(False, "error", "device.lost", "there", source="base")
    assert [occurrence.code for occurrence in log.active] == ["limit.temperature"]
    assert len(changes) == 3
