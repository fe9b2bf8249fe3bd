"""`make honesty`: a thousand worlds in which nothing unmarked may be wrong.

``python -m benchmarks.honesty --seed 37 -v`` runs world 37 alone and prints its events;
without ``-v`` it has the options of all programs of trials.
"""

import argparse
import logging
import sys
from functools import partial

from benchmarks.honesty.families import FAMILIES
from benchmarks.honesty.plan import draw_plan, world_number
from benchmarks.honesty.table import verdict
from benchmarks.honesty.world import run_world, world_line
from benchmarks.trials.program import Program
from benchmarks.trials.series import Series

WORLDS = 1000
FOLDERS = ("benchmarks", "daemon", "drivers", "kinematics", "protocol", "simulator")


def series(_options: argparse.Namespace | None = None) -> list[Series[int]]:
    return [
        Series(name, partial(world_number, index), world_line, WORLDS // len(FAMILIES))
        for index, name in enumerate(FAMILIES)
    ]


def main() -> int:
    """Run the requested worlds; exit status 1 for a lie, or doubt without a fault."""
    if {"-v", "--verbose"} & {*sys.argv}:
        parser = argparse.ArgumentParser(prog="python -m benchmarks.honesty")
        parser.add_argument("--seed", type=int, default=0)
        parser.add_argument("-v", "--verbose", action="store_true", required=True)
        logging.disable(logging.CRITICAL)
        plan = draw_plan(parser.parse_args().seed)
        print(plan)
        outcome = run_world(plan, is_verbose=True)
        print(outcome.tally)
        return int(bool(outcome.tally.lies))
    return Program("benchmarks.honesty", series, verdict, folders=FOLDERS).main()


if __name__ == "__main__":
    sys.exit(main())
