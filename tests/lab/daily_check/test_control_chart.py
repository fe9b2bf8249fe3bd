"""Control charts: rates against simulation, judgements against textbook numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from traverse.lab.daily_check.control_chart import (
    BASE,
    EWMA_LIMIT,
    INDIVIDUAL,
    RANGE,
    WEIGHT,
    charted,
    drift_per_check,
    ewma_rate,
    individual_rate,
    range_rate,
    rules,
    settled_ewma_rate,
)


@pytest.mark.parametrize("side", ["both", "above"])
def test_rates_are_those_of_simulated_checks(side):
    rng = np.random.default_rng(5)
    z = rng.standard_normal((20_000, 400))
    size = np.abs if side == "both" else (lambda x: x)
    n = z.size
    assert np.mean(size(z) > INDIVIDUAL) == pytest.approx(
        individual_rate(side), abs=4 * np.sqrt(individual_rate(side) / n)
    )
    steps = size(np.diff(z, axis=1)) > RANGE
    assert np.mean(steps) == pytest.approx(
        range_rate(side), abs=6 * np.sqrt(range_rate(side) / n)
    )
    ewma = np.zeros(len(z))
    alive = np.ones(len(z), bool)
    alarms = checks = 0
    for column in z.T:
        ewma = (1 - WEIGHT) * ewma + WEIGHT * column
        checks += alive.sum()
        broken = alive & (size(ewma) > EWMA_LIMIT)
        alarms += broken.sum()
        alive &= ~broken
    assert alarms / checks == pytest.approx(ewma_rate(side), rel=0.1)


def test_the_rate_beside_a_settled_base_is_that_of_bases_drawn_by_chance():
    rng = np.random.default_rng(6)
    n = 60_000
    off = rng.normal(0.0, 1.0 / np.sqrt(BASE), n)
    ewma, alive = np.zeros(n), np.ones(n, bool)
    rates = []
    for _ in range(60):
        ewma = (1 - WEIGHT) * ewma + WEIGHT * (rng.standard_normal(n) + off)
        broken = alive & (np.abs(ewma) > EWMA_LIMIT)
        rates.append(broken.sum() / alive.sum())
        alive &= ~broken
    # Those that are off leave early, so the first checks count; without the run-in.
    assert np.mean(rates[15:30]) == pytest.approx(settled_ewma_rate("both"), rel=0.15)


def test_the_ewma_rate_at_the_usual_width_is_the_published_one():
    """Lucas and Saccucci (1990): weight 0.2, 2.962 sigma: average run length 500."""
    limit = 2.962 * np.sqrt(WEIGHT / (2 - WEIGHT))
    assert 1 / ewma_rate("both", limit=float(limit)) == pytest.approx(500, rel=0.01)


def test_values_become_independent_standard_normal_numbers():
    """From the third check on, whatever mean and spread the figure has."""
    rng = np.random.default_rng(8)
    q = np.array(
        [
            [
                p.q
                for p in charted(rng.normal(7.0, 3.0, 12).tolist(), positive=False)[2:]
            ]
            for _ in range(1200)
        ]
    )
    assert stats.kstest(q.ravel(), "norm").pvalue > 0.001
    correlation = np.corrcoef(q, rowvar=False)
    assert np.abs(correlation - np.eye(q.shape[1])).max() < 0.12


def test_limits_are_where_a_value_would_be_beyond_them():
    values = [1.0, 3.0, 2.0, 2.5, 1.5, 2.2]
    last = charted(values, positive=False)[-1]
    for value, broken in ((last.high - 1e-9, False), (last.high + 1e-9, True)):
        again = charted([*values[:-1], value], positive=False)[-1]
        assert (again.q > INDIVIDUAL) is broken
        assert (rules("both")[0].name in again.alarms) is broken
    # By hand: mean 2, s = 0.7906 of five values, Student's t with 4 degrees.
    wide = stats.t.isf(stats.norm.sf(3.5), 4) * np.std(values[:5], ddof=1)
    assert last.centre == pytest.approx(2.0)
    assert last.high == pytest.approx(2.0 + wide * np.sqrt(6 / 5))
    assert last.low == pytest.approx(2.0 - wide * np.sqrt(6 / 5))


def test_positive_figures_are_judged_above_alone():
    rng = np.random.default_rng(1)
    usual = np.exp(rng.normal(-4, 0.2, 40)).tolist()
    better = charted([*usual, usual[0] / 100], positive=True)[-1]
    worse = charted([*usual, usual[0] * 100], positive=True)[-1]
    assert better.alarms == ()
    assert len(worse.alarms) == 3
    assert better.low is None
    with pytest.raises(ValueError, match="above zero"):
        charted([1.0, 0.0], positive=True)


def test_a_slow_drift_is_not_learned_once_the_base_is_settled():
    rng = np.random.default_rng(2)
    n = BASE + 120
    values = rng.normal(0, 1, n) + 0.05 * np.maximum(0, np.arange(n) - BASE)
    chart = charted(values.tolist(), positive=False)
    assert not any(p.alarms for p in chart[:BASE])
    assert rules("both")[2].name in chart[-1].alarms
    assert chart[-1].centre == pytest.approx(values[:BASE].mean())


@settings(max_examples=50)
@given(
    st.lists(st.floats(-5, 5), min_size=3, max_size=20),
    st.floats(0.1, 100),
    st.floats(-100, 100),
)
def test_another_unit_or_origin_changes_no_judgement(values, factor, shift):
    values = [round(v, 3) for v in values]
    if np.ptp(values[:2]) < 0.01:
        return
    before = charted(values, positive=False)
    after = charted([factor * v + shift for v in values], positive=False)
    for first, other in zip(before, after, strict=True):
        if first.q is not None:
            assert other.q == pytest.approx(first.q, abs=1e-4)


def test_a_drift_is_a_slope_that_chance_hardly_gives():
    rng = np.random.default_rng(3)
    values = (0.01 * np.arange(12) + rng.normal(0, 0.005, 12)).tolist()
    line = stats.linregress(range(12), values)
    assert line.pvalue < 1e-6
    assert drift_per_check(values, positive=False) == pytest.approx(line.slope)
    assert drift_per_check(values[:4], positive=False) is None
    falling = [1.0 - value for value in values]
    assert drift_per_check(falling, positive=False) == pytest.approx(-line.slope)
    assert drift_per_check(falling, positive=True) is None
    steady = rng.normal(size=(500, 12)).tolist()
    assert not any(drift_per_check(row, positive=False) for row in steady)
