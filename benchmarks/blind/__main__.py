"""`make blind`: hide effects by the hundred, diagnose, score."""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmarks.blind.outcomes import FULL, QUICK, series
from benchmarks.blind.round import Case
from benchmarks.blind.table import HEADER, rows
from benchmarks.trials.lines import Line, unbroken
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series


def judge(lines: Sequence[Line]) -> Verdict:
    """Make the score table; list which kinds were not named."""
    scored = list(rows(lines))
    text = [*_not_named(lines), HEADER, *(row.text for row in scored)]
    seconds = [line["seconds"] for line in unbroken(lines)]
    if seconds:
        median, most = np.median(seconds), np.max(seconds)
        text.append(f"\na decision took {median:.2f} s of a core, {most:.2f} s at most")
    return Verdict("\n".join(text), all(row.holds for row in scored))


def _not_named(lines: Sequence[Line]) -> list[str]:
    missed: Counter[str] = Counter()
    hidden: Counter[str] = Counter()
    for line in unbroken(lines):
        if not line["scenario"].startswith("one at"):
            continue
        kind = line["hidden"][0]["identity"][0]
        hidden[kind] += 1
        missed[kind] += not line["score"]["exact"]
    return [
        f"not named: {kind}, {count} of {hidden[kind]}"
        for kind, count in missed.most_common()
        if count
    ]


def _series(arguments: argparse.Namespace) -> list[Series[Case]]:
    counts = FULL if arguments.full else QUICK
    return series(counts, knows_masses=not arguments.without_masses)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--full", action="store_true", help="thousands of trials")
    parser.add_argument(
        "--without-masses", action="store_true", help="in the arm that is diagnosed"
    )


PROGRAM = Program("benchmarks.blind", _series, judge, _add_arguments)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
