"""`python -m benchmarks.daily_check`: warnings in simulated years of daily checks.

Years without a fault show the rate of false warnings; the others show after how many
checks a fault is found.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from benchmarks.daily_check.years import (
    BEGINS,
    CHECKS,
    SCENARIOS,
    Case,
    drawn_case,
    year,
)
from benchmarks.trials.lines import Line, unbroken
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series
from traverse.lab.daily_check.control_chart import rules
from traverse.lab.daily_check.figures import KINDS

YEARS, YEARS_WITH_FAULT = 600, 200
HEALTHY = "nothing changes"
MOST_FALSE_A_YEAR = 2.0


def series(_options: argparse.Namespace | None = None) -> list[Series[Case]]:
    return [
        Series(
            scenario,
            partial(drawn_case, scenario),
            year,
            YEARS if scenario == HEALTHY else YEARS_WITH_FAULT,
            first=1000 * number,
        )
        for number, scenario in enumerate(SCENARIOS)
    ]


def judge(lines: Sequence[Line]) -> Verdict:
    """Report all scenarios; healthy arms must seldom be warned of, others be found."""
    text, holds = [], True
    for scenario in SCENARIOS:
        years = [line for line in unbroken(lines) if line["scenario"] == scenario]
        if not years:
            continue
        first, last = np.mean([line["spat_2s_mm"] for line in years], axis=0)
        text.append(
            f"{scenario} ({len(years)} years; 2 s {1e3 * first:.1f} to "
            f"{1e3 * last:.1f} um)"
        )
        if scenario == HEALTHY:
            text += _false_warnings(years)
            holds &= warnings_a_year(years) <= MOST_FALSE_A_YEAR
        else:
            text.append(_found(years))
            holds &= bool(np.median(checks_until_found(years)) <= CHECKS - BEGINS)
    return Verdict("\n".join(text), holds)


def warned_days(line: Line) -> list[int]:
    by_rule = (days for rules in line["alarms"].values() for days in rules.values())
    return sorted({day for days in by_rule for day in days})


def n_warnings(days: list[int]) -> int:
    """Count the days with an alarm whose day before had none."""
    return sum(day - 1 not in days for day in days)


def warnings_a_year(years: Sequence[Line]) -> float:
    return float(np.mean([n_warnings(warned_days(line)) for line in years]))


def checks_until_found(years: Sequence[Line]) -> list[int]:
    """Count checks from the fault to the first alarm; `CHECKS` where there is none."""
    return [
        next((day - BEGINS + 1 for day in warned_days(line) if day >= BEGINS), CHECKS)
        for line in years
    ]


def _false_warnings(years: Sequence[Line]) -> Iterator[str]:
    """Yield the rate of false warnings, and that of each rule beside the computed."""
    yield f"  {warnings_a_year(years):.2f} warnings a year"
    for kind in KINDS:
        for rule in rules("above" if kind.positive else "both"):
            n = sum(
                n_warnings(line["alarms"][kind.key].get(rule.name, []))
                for line in years
            )
            yield (
                f"  {kind.key}, {rule.name}: {n / (CHECKS * len(years)):.3%} of "
                f"checks, computed {rule.rate:.3%}"
            )


def _found(years: Sequence[Line]) -> str:
    after = checks_until_found(years)
    low, middle, high = np.percentile(after, [10, 50, 90])
    n_found = sum(count <= CHECKS - BEGINS for count in after)
    return (
        f"  found in {n_found} of {len(years)} years, after {middle:.0f} checks "
        f"(median; {low:.0f} to {high:.0f} in eight of ten)"
    )


PROGRAM = Program("benchmarks.daily_check", series, judge)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
