import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.simulator.devices.wrong_clock import ClockTable, WrongClock

TABLES = st.builds(
    ClockTable,
    error_ppm=st.floats(-20_000.0, 20_000.0),
    drift_ppm_per_s=st.floats(-100.0, 100.0),
    drift_s=st.floats(0.0, 60.0),
    lost_every_s=st.floats(0.5, 5.0),
    lost_s=st.floats(0.0, 0.2),
    steps=st.lists(
        st.tuples(st.floats(0.0, 50.0), st.floats(-0.5, 0.5)), max_size=3
    ).map(tuple),
)


def test_a_rate_that_is_off():
    clock = WrongClock(ClockTable(error_ppm=-3000.0), error_ppm=1000.0)
    assert clock.is_steady
    assert clock.shown_s(100.0) == pytest.approx(99.8)
    assert clock.true_s(99.8) == pytest.approx(100.0)


def test_a_drift_is_a_parabola_and_then_a_line():
    clock = WrongClock(ClockTable(drift_ppm_per_s=10.0, drift_s=20.0))
    assert clock.shown_s(10.0) - 10.0 == pytest.approx(10e-6 * 50.0, abs=1e-12)
    assert clock.shown_s(30.0) - 30.0 == pytest.approx(
        10e-6 * (200.0 + 20.0 * 10.0), abs=1e-12
    )


def test_steps_losses_and_the_end():
    clock = WrongClock(
        ClockTable(
            steps=((2.0, -0.3), (3.0, 0.1)),
            lost_every_s=4.0,
            lost_s=0.01,
            stops_at_s=20.0,
        )
    )
    shown = [clock.shown_s(t) for t in (2.0, 2.1, 2.3, 2.9, 3.1, 4.1, 8.1, 20.0, 50.0)]
    assert shown == pytest.approx(
        [2.0, 2.0, 2.0, 2.6, 2.9, 3.89, 7.88, 19.75, 19.75], abs=1e-9
    )
    assert clock.true_s(19.8) == np.inf
    assert clock.true_s(2.0) == pytest.approx(2.0)
    assert clock.true_s(2.1) == pytest.approx(2.4)


@given(TABLES)
def test_it_never_runs_back_and_is_inverted(table):
    clock = WrongClock(table)
    true_s = np.linspace(0.0, 60.0, 500)
    shown_s = np.array([clock.shown_s(t) for t in true_s.tolist()])
    assert (np.diff(shown_s) >= -1e-12).all()
    back_s = clock.true_times_s(shown_s)
    assert (back_s <= true_s + 1e-6).all()
    again_s = np.array([clock.shown_s(t + 1e-9) for t in back_s.tolist()])
    assert (again_s >= shown_s - 1e-9).all()
