"""Worlds in which nothing unmarked may be wrong: ``python -m benchmarks.honesty``.

``--family latch --seed 7 -v`` runs one of them and prints what happens in it.
"""

import argparse
import json
import logging
import multiprocessing
import os
import sys
import time
from pathlib import Path

from benchmarks.honesty.families import FAMILIES
from benchmarks.honesty.plan import draw_plan
from benchmarks.honesty.table import Line, figures
from benchmarks.honesty.world import run_world, world_line

PROGRESS_S = 10.0


def main() -> int:
    """Run what is asked for; 1 for a lie, or for doubt without a fault."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.honesty")
    add = parser.add_argument
    add("--worlds", type=int, default=1000, help="in all, shared among the families")
    add("--family", choices=tuple(FAMILIES), action="append")
    add("--seed", type=int, help="of one world, or the first of all")
    add("-v", "--verbose", action="store_true", help="one world, with all it does")
    add("--out", type=Path, default=Path("build/honesty.jsonl"))
    add("--processes", type=int, default=os.cpu_count())
    add("--anew", action="store_true", help="do not continue the file")
    asked = parser.parse_args()
    families = asked.family or list(FAMILIES)
    if asked.verbose:
        logging.disable(logging.CRITICAL)
        for family in families:
            print(run_world(draw_plan(asked.seed or 0, family), is_verbose=True))
        return 0
    first = asked.seed or 0
    cases = [
        (families[number % len(families)], first + number // len(families))
        for number in range(asked.worlds)
    ]
    if asked.anew:
        asked.out.unlink(missing_ok=True)
    lines = _stored(asked.out, set(cases))
    made = {(line["family"], line["seed"]) for line in lines}
    missing = [case for case in cases if case not in made]
    print(f"{asked.out}: {len(lines)} worlds; {len(missing)} to go", flush=True)
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    shown_s = time.monotonic()
    with (
        multiprocessing.get_context("forkserver").Pool(asked.processes) as pool,
        asked.out.open("a", encoding="utf-8") as file,
    ):
        for line in pool.imap_unordered(world_line, missing):
            file.write(json.dumps(line) + "\n")
            file.flush()
            lines.append(line)
            if time.monotonic() > shown_s + PROGRESS_S:
                shown_s = time.monotonic()
                print(f"{len(lines)} of {len(cases)}", flush=True)
    lines.sort(key=lambda line: (line["family"], line["seed"]))
    broken = [line for line in lines if line["error"] is not None]
    for line in broken:
        print(f"broke: {line['family']} {line['seed']}: {line['error']}")
    text, holds = figures(lines)
    print(text)
    return 0 if holds and not broken else 1


def _stored(path: Path, wanted: set[tuple[str, int]]) -> list[Line]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        lines = [json.loads(text) for text in file if text.endswith("\n")]
    latest = {(line["family"], line["seed"]): line for line in lines}
    return [line for case, line in latest.items() if case in wanted]


if __name__ == "__main__":
    sys.exit(main())
