"""`make blind`: hide effects by the hundred, let diagnosis find them, score it."""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import takewhile
from pathlib import Path

import numpy as np

from benchmarks.blind.outcomes import (
    FULL,
    QUICK,
    Line,
    append,
    missing,
    run_one,
    stored,
)
from benchmarks.blind.table import HEADER, rows
from benchmarks.tools.workers import add_workers, unordered

_MOST_WRONG = 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the runs that are missing and print the table; 1 if a row does not hold."""
    given = _arguments(arguments)
    wanted = dict(FULL if given.full else QUICK)
    if given.scenarios:
        wanted = {n: c for n, c in wanted.items() if _fits(n, given.scenarios)}
    if given.runs is not None:
        total = sum(wanted.values())
        wanted = {n: max(1, c * given.runs // total) for n, c in wanted.items()}
    lines = stored(given.out)
    todo = list(missing(lines, wanted, given.seed))
    begun_s = time.monotonic()
    ends_s = float("inf")
    if given.minutes is not None:
        ends_s = begun_s + 60.0 * given.minutes
    print(f"{given.out}: {len(lines)} runs; {len(todo)} to go", flush=True)
    for line in _made(
        todo, ends_s, given.scheduler, knows_masses=not given.without_masses
    ):
        append(given.out, line)
        lines.append(line)
    _print_errors(lines)
    holds = True
    print(HEADER)
    for row in rows(lines):
        print(row.text)
        holds &= row.holds
    seconds = [line["seconds"] for line in lines if "seconds" in line]
    if seconds:
        median, most = np.median(seconds), np.max(seconds)
        print(f"\na decision took {median:.2f} s of a core, {most:.2f} s at most")
    print(f"took {time.monotonic() - begun_s:.0f} s")
    return 0 if holds else 1


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind")
    parser.add_argument("--runs", type=int, help="about so many, instead of 200")
    parser.add_argument("--full", action="store_true", help="thousands of runs")
    parser.add_argument(
        "--out", type=Path, default=Path("build/blind.jsonl"), help="a line each run"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the first run")
    parser.add_argument("--scenarios", nargs="*", default=[], help="parts of names")
    parser.add_argument(
        "--minutes", type=float, help="begin no run after that; 0: only the table"
    )
    parser.add_argument(
        "--without-masses", action="store_true", help="in the arm that is diagnosed"
    )
    add_workers(parser)
    given = parser.parse_args(arguments)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    return given


def _fits(name: str, parts: Sequence[str]) -> bool:
    return any(part in name for part in parts)


def _made(
    todo: Sequence[tuple[str, int]],
    ends_s: float,
    scheduler: str | None,
    *,
    knows_masses: bool,
) -> Iterator[Line]:
    """Make runs, reported in the order in which they end."""
    work = partial(run_one, knows_masses=knows_masses)
    in_time = takewhile(lambda _: time.monotonic() < ends_s, todo)
    for n_done, line in enumerate(unordered(scheduler, work, in_time), 1):
        yield line
        if n_done % 20 == 0:
            print(f"{n_done} of {len(todo)}", flush=True)


def _print_errors(lines: Sequence[Line]) -> None:
    """List what was not found, so that it can be made again from its seed."""
    for line in [one for one in lines if one["error"]][:_MOST_WRONG]:
        last = line["error"].strip().splitlines()[-1]
        print(f"broke: {line['scenario']}, seed {line['seed']}: {last}")
    missed: Counter[str] = Counter()
    hidden: Counter[str] = Counter()
    for line in lines:
        if line["error"] or not line["scenario"].startswith("one at"):
            continue
        kind = line["hidden"][0]["identity"][0]
        hidden[kind] += 1
        missed[kind] += not line["score"]["exact"]
    for kind, count in missed.most_common():
        if count:
            print(f"not named: {kind}, {count} of {hidden[kind]}")


if __name__ == "__main__":
    sys.exit(main())
