"""`python -m benchmarks.strangers DIR [table|choices|subsets]`: other people's arms.

`table` is that of docs/strangers.md; `choices` tests whether a difference in it is
chance, `subsets` whether random subsets of poses converge.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.strangers import choices, subsets, table
from benchmarks.strangers.sets import read_sets
from benchmarks.trials.lines import Line, unbroken
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series

KINDS = {"table": table, "choices": choices, "subsets": subsets}


def series(arguments: argparse.Namespace) -> list[Series[Any]]:
    sets = list(read_sets(arguments.folder))
    if arguments.kind == "table":
        return table.series(sets, diagnose=arguments.diagnose)
    return choices.series(sets) if arguments.kind == "choices" else subsets.series(sets)


def judge(lines: Sequence[Line]) -> Verdict:
    text, holds = [], True
    for name, kind in KINDS.items():
        of_kind = [
            line for line in unbroken(lines) if line["scenario"].startswith(name)
        ]
        if of_kind:
            text += kind.report(of_kind)
            holds &= not any(line.get("is_wrong") for line in of_kind)
    return Verdict("\n".join(text), holds)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="with the sets, as described")
    parser.add_argument("kind", nargs="?", choices=KINDS, default="table")
    parser.add_argument(
        "--diagnose", action="store_true", help="also with the effects that are found"
    )


PROGRAM = Program("benchmarks.strangers", series, judge, _add_arguments)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
