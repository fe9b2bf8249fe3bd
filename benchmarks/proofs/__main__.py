"""`make prove`: the statistics of the identification over hundreds of campaigns."""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.proofs.conditions import EXPECTED, condition_numbers
from benchmarks.proofs.statistics import (
    BLUNDER_HEADER,
    CLEAN_HEADER,
    blunder_verdict,
    clean_verdict,
)
from benchmarks.proofs.trials import MIXES, PER_POSE_SET, Outcome, draw, run
from benchmarks.trials.lines import Line, outcomes
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series

SHARES = (0.0, 0.01, 0.02, 0.05)
N_CLEAN, N_SPOILT, N_CONDITIONS = 2000, 100, 15
CONDITION_HEADER = (
    "| travel | geometry | + 1st harmonic | + 1st and 2nd | expected |\n"
    "|---|---|---|---|---|"
)


def series(_asked: argparse.Namespace | None = None) -> list[Series[Any]]:
    campaigns = [
        Series(
            _name(mix, share),
            partial(draw, mix, share),
            run,
            N_SPOILT if share else N_CLEAN,
            PER_POSE_SET,
        )
        for share in SHARES
        for mix in MIXES
    ]
    conditions = [
        Series(
            _condition(travel), int, partial(condition_numbers, travel), N_CONDITIONS
        )
        for travel in EXPECTED
    ]
    return [*campaigns, *conditions]


def _name(mix: str, share: float) -> str:
    return f"{mix}, {share:.0%} blunders"


def _condition(travel: str) -> str:
    return f"condition, {travel}"


def judge(lines: Sequence[Line]) -> Verdict:
    campaigns = {
        (mix, share): [Outcome(**each) for each in outcomes(lines, _name(mix, share))]
        for mix in MIXES
        for share in SHARES
    }
    clean = [
        clean_verdict(mix, campaigns[mix, 0.0]) for mix in MIXES if campaigns[mix, 0.0]
    ]
    spoilt = [
        blunder_verdict(mix, share, campaigns[mix, share], campaigns[mix, 0.0])
        for mix in MIXES
        for share in SHARES[1:]
        if campaigns[mix, share] and campaigns[mix, 0.0]
    ]
    text = [CLEAN_HEADER, *(verdict.line for verdict in clean)]
    text += ["", BLUNDER_HEADER, *(verdict.line for verdict in spoilt)]
    text += ["", CONDITION_HEADER]
    for travel, expected in EXPECTED.items():
        numbers = outcomes(lines, _condition(travel))
        if numbers:
            shown = " | ".join(f"{each:.0f}" for each in np.median(numbers, axis=0))
            figures = ", ".join(f"{number:.0f}" for number in expected)
            text.append(f"| {travel} | {shown} | {figures} |")
    return Verdict("\n".join(text), all(each.holds for each in (*clean, *spoilt)))


PROGRAM = Program("benchmarks.proofs", series, judge)

if __name__ == "__main__":
    sys.exit(PROGRAM.main())
