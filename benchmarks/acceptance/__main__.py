"""`make prove-acceptance`: rates of wrong acceptance, with and without guard bands.

A thousand simulated arms are tested by ISO 10360-12. The true value of each figure is
that of exact standards at an exactly known temperature, with the same touches.
Certificates and thermometer have errors; the stated uncertainty is that of every
certificate of acceptance. Limits are drawn within three standard uncertainties of the
true figure, so that all arms are near them.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.acceptance.arms import (
    FIGURES,
    Tested,
    drawn_again,
    drawn_arm,
    tested,
    tested_again,
)
from benchmarks.acceptance.rates import agreement, coverage, procedure_rates, rates
from benchmarks.trials.lines import Line, outcomes
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series

ARMS, AGAIN = "arms", "one arm again"
N_ARMS, N_AGAIN, BATCH = 1000, 200, 10
MOST_FALSE = 0.05


def series(_asked: argparse.Namespace) -> list[Series[Any]]:
    return [
        Series(ARMS, drawn_arm, tested, N_ARMS, BATCH, first=1),
        Series(AGAIN, drawn_again, tested_again, N_AGAIN, BATCH, first=10_000),
    ]


def judge(lines: Sequence[Line]) -> Verdict:
    """Make the tables; the guard bands hold if they accept few bad arms."""
    tested = _outcomes(lines)
    of_rules = [row for key in FIGURES for row in rates(tested, key)]
    text = [
        *_rate_lines([*of_rules, *procedure_rates(tested)]),
        *_agreement_lines(tested),
        *_again_lines(outcomes(lines, AGAIN)),
    ]
    holds = all(
        row["false_accept"] <= MOST_FALSE for row in of_rules if row["rule"] != "simple"
    )
    return Verdict("\n".join(text), holds)


def _outcomes(lines: Sequence[Line]) -> list[Tested]:
    return [Tested(**each) for each in outcomes(lines, ARMS)]


def _rate_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield (
        "| figure | rule | u [um] | bad arms accepted | good arms "
        "rejected | good accepted | bad rejected | neither |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for row in rows:
        cells = [row["figure"], row["rule"]]
        cells += [f"{1e3 * row['u_mm']:.2f}"]
        names = ("false_accept", "false_reject", "accepted_good", "rejected_bad")
        cells += [f"{row[name]:.1%}" for name in (*names, "neither")]
        yield f"| {' | '.join(cells)} |"


def _agreement_lines(tested: Sequence[Tested]) -> Iterator[str]:
    yield "\n| figure | true 5 %, 50 %, 95 % [um] | rms off [um] | in u | within U |"
    yield "|---|---|---|---|---|"
    for row in (agreement(tested, key) for key in FIGURES):
        true = ", ".join(f"{1e3 * value:.1f}" for value in row["true_mm"])
        yield (
            f"| {row['figure']} | {true} | {1e3 * row['rms_off_mm']:.2f} | "
            f"{row['rms_off_u']:.2f} | {row['covered']:.1%} |"
        )
    of_lengths = coverage(tested)
    yield (
        f"\n{of_lengths['lengths']} lengths: {of_lengths['covered']:.1%} within U, "
        f"{of_lengths['within_2u']:.1%} within 2 u, "
        f"rms {of_lengths['rms_u']:.2f} u; sizes at the location that P_SIZE is of: "
        f"{of_lengths['counted_sizes']:.1%} within U"
    )


def _again_lines(tests: Sequence[dict[str, float]]) -> Iterator[str]:
    yield f"\n| one arm, {len(tests)} tests | mean [um] | std | least | largest |"
    yield "|---|---|---|---|---|"
    for key in tests[0] if len(tests) > 1 else ():
        values = 1e3 * np.array([test[key] for test in tests])
        figures = (values.mean(), values.std(ddof=1), values.min(), values.max())
        yield f"| {key} | {' | '.join(f'{figure:.1f}' for figure in figures)} |"


def _paint(lines: Sequence[Line], folder: Path) -> None:
    from benchmarks.acceptance.pictures import paint  # noqa: PLC0415 - heavy

    paint(_outcomes(lines), folder)


PROGRAM = Program("benchmarks.acceptance", series, judge, paint=_paint)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
