"""`make prove`: the statistics of the identification over hundreds of campaigns."""

import argparse
import sys
import time
from collections.abc import Sequence

from benchmarks.proofs.conditions import EXPECTED, median_conditions
from benchmarks.proofs.statistics import (
    BLUNDER_HEADER,
    CLEAN_HEADER,
    blunder_verdict,
    clean_verdict,
)
from benchmarks.proofs.trials import MIXES, Outcome, outcomes, tasks
from benchmarks.tools.workers import add_workers, ordered

SHARES = (0.01, 0.02, 0.05)
PER_POSE_SET = 10


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if something does not hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proofs")
    parser.add_argument("--seeds", type=int, default=2000, help="campaigns of each mix")
    parser.add_argument(
        "--blunder-seeds", type=int, default=100, help="campaigns of each share"
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--mixes", nargs="*", default=list(MIXES))
    add_workers(parser)
    given = parser.parse_args(arguments)
    begun_s = time.monotonic()
    holds = _prove(given)
    print("\n| travel | geometry | + 1st harmonic | + 1st and 2nd | expected |")
    print("|---|---|---|---|---|")
    found = ordered(given.scheduler, median_conditions, EXPECTED)
    for (travel, expected), numbers in zip(EXPECTED.items(), found, strict=True):
        shown = " | ".join(f"{number:.0f}" for number in numbers)
        wanted = ", ".join(f"{number:.0f}" for number in expected)
        print(f"| {travel} | {shown} | {wanted} |", flush=True)
    print(f"\ntook {time.monotonic() - begun_s:.0f} s")
    return 0 if holds else 1


def _prove(given: argparse.Namespace) -> bool:
    holds = True
    seeds = range(given.first, given.first + given.seeds)
    clean: dict[str, list[Outcome]] = {}
    print(CLEAN_HEADER)
    for mix in given.mixes:
        clean[mix] = _run(given.scheduler, mix, seeds, 0.0)
        verdict = clean_verdict(mix, clean[mix])
        holds &= verdict.holds
        print(verdict.line, flush=True)
    few = seeds[: given.blunder_seeds]
    print("\n" + BLUNDER_HEADER)
    for mix in given.mixes:
        for share in SHARES:
            found = _run(given.scheduler, mix, few, share)
            verdict = blunder_verdict(mix, share, found, clean[mix])
            holds &= verdict.holds
            print(verdict.line, flush=True)
    return holds


def _run(scheduler: str | None, mix: str, seeds: range, share: float) -> list[Outcome]:
    groups = ordered(scheduler, outcomes, tasks(mix, seeds, PER_POSE_SET, share))
    return [outcome for group in groups for outcome in group]


if __name__ == "__main__":
    sys.exit(main())
