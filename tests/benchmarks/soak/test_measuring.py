"""The crash test judges itself: a daemon that was down has shown nothing."""

import pytest

from benchmarks.soak.judge import Work, measuring_s


def work(*, measuring_s=80.0, starts=10, sessions=9):
    return Work(
        seconds=100.0, measuring_s=measuring_s, starts=starts, sessions=sessions
    )


def test_run_of_a_daemon_at_work_is_good():
    assert work().share == 0.8
    assert work().faults() == []


def test_run_of_a_daemon_that_rarely_measured_has_shown_nothing():
    [fault] = work(measuring_s=13.0).faults()

    assert "measuring for 13% of 100 s" in fault
    assert "daemon.log" in fault


def test_run_whose_starts_led_nowhere_has_shown_nothing():
    [fault] = work(starts=229, sessions=7).faults()

    assert "7 sessions with points in 229 starts" in fault


@pytest.mark.parametrize(("sessions", "n_faults"), [(4, 1), (5, 0)])
def test_half_of_the_starts_are_enough(sessions, n_faults):
    assert len(work(sessions=sessions).faults()) == n_faults


def test_run_of_no_length_has_shown_nothing():
    assert Work(0.0, 0.0, starts=0, sessions=0).share == 0.0


@pytest.mark.parametrize(
    ("times_s", "expected_s"),
    [
        ([], 0.0),
        ([20.0], 0.0),
        ([20.0, 20.5, 21.5], 1.5),
        ([20.0, 21.0, 30.0, 31.0], 2.0),  # nine seconds without
        ([5.0, 9.9, 10.2, 11.2, 99.9, 100.1], 1.0),  # before and after do not count
    ],
)
def test_time_of_measuring_is_that_of_acknowledgements_without_pauses(
    times_s, expected_s
):
    assert measuring_s(times_s, 10.0, 100.0) == pytest.approx(expected_s)
