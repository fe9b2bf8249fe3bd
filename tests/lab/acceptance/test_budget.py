"""Budgets against the GUM's own example, differences, and chance."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy import stats

from tests.lab.measurements import artefact, limits, measured, on_a_ball
from tests.lab.measurements import touches as touched_at
from traverse.lab.acceptance.budget import (
    Budget,
    CertifiedValue,
    Contribution,
    combined,
    correlation,
    length_budget,
    repeatability,
)
from traverse.lab.acceptance.limits import Standards
from traverse.lab.acceptance.monte_carlo import Model, propagated
from traverse.lab.acceptance.procedures.lengths import errors_of
from traverse.lab.artefacts.materials import MATERIALS, Expansion

P = 0.9545
STANDARDS = Standards(
    temperature_std_c=0.1,
    temperature_degrees=4,
    fixture_std_mm=3e-4,
    fixture_degrees=9,
    form_mm=6e-4,
)


def bar(length_mm, identity="bar", warmer_c=2.0):
    expansion = Expansion(11.5e-6, 0.6e-6)
    value = CertifiedValue(identity, length_mm, 5e-4, expansion, warmer_c, 1.2)
    return length_budget(value, STANDARDS)


def test_the_end_gauge_of_the_gum():
    # JCGM 100:2008, H.1: a gauge of 50 mm by comparison; table H.1 and H.1.6. The same
    # numbers are public as examples of other programs.
    lines = (
        Contribution("standard", "", 25e-6, degrees=18.0),
        Contribution("repeated observations", "", 5.8e-6, "", "A", 24.0),
        Contribution("random effects of the comparator", "", 3.9e-6, "", "A", 5.0),
        Contribution("systematic effects of it", "", 6.7e-6, degrees=8.0),
        Contribution("difference of expansion coefficients", "", 2.9e-6, degrees=50.0),
        Contribution("difference of temperatures", "", 16.6e-6, degrees=2.0),
    )
    budget = Budget(lines)
    assert budget.standard_mm == pytest.approx(32e-6, abs=0.5e-6)
    assert int(budget.degrees) == 16
    assert budget.coverage_factor(0.99) == pytest.approx(2.92, abs=0.005)
    expanded_mm = budget.coverage_factor(0.99) * budget.standard_mm
    assert expanded_mm == pytest.approx(93e-6, abs=1e-6)


def test_effective_degrees_of_the_gum():
    # JCGM 100:2008, G.4.1: relative uncertainties of 0.25, 0.57 and 0.82 %, of 10, 5
    # and 15 readings, give 1.03 %, 19.0 degrees of freedom, and 2.2 % at 95 %.
    readings = ((0.25, 9.0), (0.57, 4.0), (0.82, 14.0))
    budget = Budget(
        tuple(
            Contribution(f"X{number}", "", percent, "", "A", degrees)
            for number, (percent, degrees) in enumerate(readings, 1)
        )
    )
    assert budget.standard_mm == pytest.approx(1.03, abs=0.005)
    assert budget.degrees == pytest.approx(19.0, abs=0.05)
    assert budget.coverage_factor(0.95) * budget.standard_mm == pytest.approx(
        2.2, abs=0.05
    )


def test_one_wide_quantity_of_supplement_1():
    # JCGM 101:2008, 9.2.4: with one of four rectangular quantities ten times as wide
    # u = 10.1, and 95 % are within -17.0 and 17.0; the linear budget says 19.9.
    three = (Contribution("X", "", 1.0, distribution="uniform"),) * 3
    wide = Contribution("X4", "", 10.0, distribution="uniform")
    budget = Budget((*three, wide))
    linear_mm = budget.coverage_factor(0.95) * budget.standard_mm
    assert linear_mm == pytest.approx(19.9, abs=0.05)
    drawn = propagated(Model(np.array([100.0]), (budget,)), 100.0, linear_mm, 0.95)
    assert drawn.standard_mm == pytest.approx(10.1, abs=0.1)
    assert drawn.low_mm == pytest.approx(100.0 - 17.0, abs=0.3)
    assert drawn.high_mm == pytest.approx(100.0 + 17.0, abs=0.3)
    assert not drawn.agrees


def test_a_budget_beside_a_computation_of_its_own():
    length, (mean, std) = 1200.0, (11.5e-6, 0.6e-6)
    parts = {
        "calibration": (5e-4, inf),
        "expansion": (length * std * 2.0, inf),
        "temperature": (length * mean * 0.1, 4),
        "form": (6e-4 / np.sqrt(12.0) * 1.2, inf),
        "fixture": (3e-4, 9),
    }
    sizes, degrees = np.array(list(parts.values())).T
    u = np.sqrt(np.sum(sizes**2))
    nu = u**4 / np.sum(sizes**4 / degrees)
    budget = bar(length)
    assert [line.standard_mm for line in budget.lines] == pytest.approx(list(sizes))
    assert [line.evaluation for line in budget.lines] == ["B", "B", "A", "B", "A"]
    assert budget.standard_mm == pytest.approx(u)
    assert budget.degrees == pytest.approx(nu)
    expected = stats.t.ppf(0.5 + P / 2, int(nu))
    assert budget.coverage_factor(P) == pytest.approx(expected)
    assert Budget((budget.lines[0],)).coverage_factor(P) == pytest.approx(2.0, abs=1e-3)


def test_lines_of_the_arm_are_listed_and_take_no_part():
    budget = bar(500.0)
    with_arm = budget.with_lines(repeatability("repeatability", "", 0.008, 70))
    assert with_arm.standard_mm == budget.standard_mm
    assert with_arm.degrees == budget.degrees
    assert with_arm.with_arm_mm == pytest.approx(np.hypot(budget.standard_mm, 0.008))
    assert 70 < with_arm.degrees_with_arm < 80


def drawn_errors(budgets, rng, n):
    """Errors of all values by draws of every source, independent of the product."""
    sources = {}
    errors = np.zeros((n, len(budgets)))
    for column, budget in enumerate(budgets):
        for line in budget.lines:
            units = rng.standard_normal(n)
            if line.source:
                units = sources.setdefault(line.source, units)
            errors[:, column] += line.signed_mm * units
    return errors


def test_correlation_of_lengths_and_of_what_is_made_of_them():
    budgets = [bar(400.0, "short"), bar(400.0, "short", -1.0), bar(1400.0, "long")]
    errors = drawn_errors(budgets, np.random.default_rng(4), 200_000)
    np.testing.assert_allclose(
        correlation(budgets), np.corrcoef(errors.T), atol=0.01, rtol=0
    )
    slopes = np.array([0.7, -0.2, 1.1])
    of_all = combined(budgets, slopes)
    assert of_all.standard_mm == pytest.approx(np.std(errors @ slopes), rel=0.01)


def test_of_equal_largest_values_the_larger_counts_and_the_report_says_so():
    line = Contribution("fixture", "", 0.001)
    model = Model(np.array([0.02, -0.02]), (Budget((line,)),) * 2)
    drawn = propagated(model, 0.02, 0.002, P)
    # The larger of two normal deviates: mean 1/sqrt(pi), variance 1 - 1/pi.
    assert drawn.standard_mm == pytest.approx(0.001 * np.sqrt(1 - 1 / np.pi), rel=0.03)
    middle = stats.norm.ppf(np.sqrt(np.array([0.5 - P / 2, 0.5 + P / 2])))
    expected = 0.02 + 0.001 * middle
    assert [drawn.low_mm, drawn.high_mm] == pytest.approx(expected, abs=1e-4)
    assert not drawn.agrees
    # Where one is larger by far, the budget of that one holds.
    apart = replace(model, values_mm=np.array([0.02, -0.01]))
    assert propagated(apart, 0.02, 0.002, P).agrees


def test_the_form_of_balls_moves_a_bar_as_differences_say():
    # Weakly along the bar, so that smooth deviations are no more.
    pattern = np.array([[0.0, 0, 1], [0.6, -0.8, 0], [-0.6, 0.8, 0], [0.48, 0.64, 0.6]])
    ends = [on_a_ball(c, 10.0, pattern) for c in ([0.0, 0, 0], [200.0, 220.0, -9.0])]
    length_mm = float(np.linalg.norm([200.0, 220.0, -9.0]))
    keys = {"radius_mm": 10.0, "distance_mm": length_mm, "distance_std_mm": 1e-3}
    standard, places = artefact("L", "ball_bar", **keys), np.concatenate(ends)
    features = ["1"] * len(pattern) + ["2"] * len(pattern)
    stated = limits(standards={"form_mm": 6e-4})

    def error_of(places_mm):
        data = measured((standard, touched_at(places_mm, features)))
        (error,) = errors_of(data, "L", "e_uni", stated)
        return error

    step, squares = 1e-4, 0.0
    for row, outwards in enumerate(np.tile(pattern, (2, 1))):
        moved = places.copy()
        moved[row] += step * outwards
        slope = (error_of(moved).error_mm - error_of(places).error_mm) / step
        squares += slope**2
    (line,) = [
        line
        for line in error_of(places).budget.lines
        if line.name == "form of the ball"
    ]
    expected = 6e-4 / np.sqrt(12.0) * np.sqrt(squares)
    assert line.standard_mm == pytest.approx(expected, rel=1e-3)


def test_u_covers_where_the_temperature_is_of_a_few_readings():
    # Strategy: 4000 laboratories, binomial standard deviation 0.33 %. With k = 2 the
    # same budgets cover less, so that the t-distribution is seen to be needed.
    rng, covered = np.random.default_rng(6), {"t": 0, "2": 0}
    n, length_mm, per_c = 4000, 1500.0, 11.5e-6
    for _ in range(n):
        readings = 0.1 * rng.standard_normal(5)
        stated = Standards(
            temperature_std_c=float(readings.std(ddof=1) / np.sqrt(5)),
            temperature_degrees=4,
        )
        value = CertifiedValue("bar", length_mm, 2e-4, Expansion(per_c, 1e-12), 0.0)
        budget = length_budget(value, stated)
        off_mm = length_mm * per_c * readings.mean() + 2e-4 * rng.standard_normal()
        u_mm = budget.standard_mm
        covered["t"] += abs(off_mm) <= budget.coverage_factor(P) * u_mm
        covered["2"] += abs(off_mm) <= 2.0 * u_mm
    assert covered["t"] / n == pytest.approx(P, abs=0.012)
    assert covered["2"] / n < 0.93


def test_what_is_not_stated_leaves_no_uncertainty():
    unknown = CertifiedValue("bar", 500.0, 5e-4, Expansion(None, None), 0.0)
    budget = length_budget(unknown, STANDARDS)
    assert budget.standard_mm is None
    (line,) = [line for line in budget.lines if line.standard_mm is None]
    assert line.formula.startswith("give material, or expansion_per_c")
    steel = replace(unknown, expansion=MATERIALS["steel"])
    assert length_budget(steel, STANDARDS).standard_mm is not None
    assert length_budget(steel, Standards()).standard_mm is None
