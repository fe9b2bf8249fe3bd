"""A board that prints faster or slower than it did: by hand."""

from traverse.drivers.text_line.line_rate import LineRateMonitor

MS = 1_000_000


def changes(periods_ms, *, timed):
    """Periods [ms] that are noticed while lines come at these, from 10 ms on."""
    monitor, now_ns = LineRateMonitor(10.0 * MS, 0), 0
    noticed = []
    for period_ms in periods_ms:
        now_ns += period_ms * MS
        monitor.add(1, period_ms * MS if timed else None)
        if monitor.has_changed(now_ns):
            noticed.append(round(monitor.period_ns / MS))
    return noticed


def test_another_rate_is_noticed_once():
    assert changes([10] * 300 + [50] * 60, timed=True) == [50]
    assert changes([10] * 300 + [50] * 80, timed=False) == [50]
    assert changes([10] * 300 + [2] * 1600, timed=False) == [2]


def test_one_interruption_is_none():
    for timed in (False, True):
        assert changes([10] * 150 + [900] + [10] * 400, timed=timed) == []


def test_lines_that_waited_and_come_at_once_are_none():
    # Half a second nothing, then all that waited: twice.
    bunch = [10] * 120 + [500] + [0] * 50
    assert changes([*bunch, *bunch, *[10] * 300], timed=False) == []


def test_losses_in_a_timed_line_are_none():
    assert changes([10, 10, 30] * 200, timed=True) == []


def test_a_timer_that_stands_still_is_none():
    monitor = LineRateMonitor(10.0 * MS, 0)
    for number in range(1, 500):
        monitor.add(1, 0.0)
        assert not monitor.has_changed(number * 10 * MS)
