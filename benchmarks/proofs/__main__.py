"""`make prove`: the statistics of the identification over hundreds of campaigns."""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks.proofs.conditions import EXPECTED, median_conditions
from benchmarks.proofs.statistics import (
    BLUNDER_HEADER,
    CLEAN_HEADER,
    blunder_verdict,
    clean_verdict,
)
from benchmarks.proofs.trials import MIXES, Outcome, outcomes, tasks

SHARES = (0.01, 0.02, 0.05)
PER_POSE_SET = 10
N_CONDITION_SETS = 15


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; 1 if something does not hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.proofs")
    parser.add_argument("--seeds", type=int, default=2000, help="campaigns of each mix")
    parser.add_argument(
        "--blunder-seeds", type=int, default=100, help="campaigns of each share"
    )
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--mixes", nargs="*", default=list(MIXES))
    given = parser.parse_args(arguments)
    begun_s = time.monotonic()
    # Many small matrices: threads of the linear algebra would only get in the way.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        holds = _prove(pool, given)
        print("\n| travel | geometry | + 1st harmonic | + 1st and 2nd | expected |")
        print("|---|---|---|---|---|")
        sets = [N_CONDITION_SETS] * len(EXPECTED)
        found = pool.map(median_conditions, EXPECTED, sets)
        for (travel, expected), numbers in zip(EXPECTED.items(), found, strict=True):
            shown = " | ".join(f"{number:.0f}" for number in numbers)
            wanted = ", ".join(f"{number:.0f}" for number in expected)
            print(f"| {travel} | {shown} | {wanted} |", flush=True)
    print(f"\ntook {time.monotonic() - begun_s:.0f} s")
    return 0 if holds else 1


def _prove(pool: ProcessPoolExecutor, given: argparse.Namespace) -> bool:
    holds = True
    seeds = range(given.first, given.first + given.seeds)
    clean: dict[str, list[Outcome]] = {}
    print(CLEAN_HEADER)
    for mix in given.mixes:
        clean[mix] = _run(pool, mix, seeds, 0.0)
        verdict = clean_verdict(mix, clean[mix])
        holds &= verdict.holds
        print(verdict.line, flush=True)
    few = seeds[: given.blunder_seeds]
    print("\n" + BLUNDER_HEADER)
    for mix in given.mixes:
        for share in SHARES:
            found = _run(pool, mix, few, share)
            verdict = blunder_verdict(mix, share, found, clean[mix])
            holds &= verdict.holds
            print(verdict.line, flush=True)
    return holds


def _run(
    pool: ProcessPoolExecutor, mix: str, seeds: range, share: float
) -> list[Outcome]:
    groups = pool.map(outcomes, tasks(mix, seeds, PER_POSE_SET, share))
    return [outcome for group in groups for outcome in group]


if __name__ == "__main__":
    sys.exit(main())
