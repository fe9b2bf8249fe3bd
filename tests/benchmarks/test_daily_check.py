from benchmarks.daily_check.__main__ import HEALTHY, judge, n_warnings
from benchmarks.daily_check.years import BEGINS, SCENARIOS

KEYS = ("spat_2s_mm", "spat_max_mm", "sphere_form_mm", "sphere_diameter_mm")
KNOCKED = next(name for name in SCENARIOS if "knocked" in name)


def a_year(scenario, *days):
    alarms = {"sphere_form_mm": {"rule": list(days)}}
    line = {"scenario": scenario, "error": None, "spat_2s_mm": [0.02, 0.02]}
    return {**line, "alarms": {key: {} for key in KEYS} | alarms}


def test_a_warning_that_lasts_is_one():
    assert n_warnings([3, 4, 5, 9]) == 2


def test_years_without_a_fault_are_seldom_warned_of_and_faults_are_found():
    years = [a_year(HEALTHY, 17), a_year(KNOCKED, 3, BEGINS + 4)]
    verdict = judge(years)
    assert verdict.holds
    assert "1.00 warnings a year" in verdict.text
    assert "found in 1 of 1 years, after 5 checks" in verdict.text
    assert not judge([a_year(HEALTHY, 17, 19, 90)]).holds
    assert not judge([a_year(KNOCKED, 3)]).holds
