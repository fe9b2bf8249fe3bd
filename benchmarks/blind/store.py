"""The file of runs: a JSON line each, appended, so that it can be gone on with."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from benchmarks.blind.outcomes import Line


def stored(path: Path) -> list[Line]:
    """Read the lines; one that was cut off in the middle of writing is left out."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        return [json.loads(text) for text in file if text.endswith("\n")]


def append(path: Path, line: Line) -> None:
    """Add a line; half a line that an interruption left at the end goes."""
    text = json.dumps(line, allow_nan=False) + "\n"
    with path.open("a+b") as file:
        file.seek(0)
        whole = file.read().rfind(b"\n") + 1
        file.truncate(whole)
        file.write(text.encode())


def missing(
    lines: Iterable[Line], wanted: Mapping[str, int], first_seed: int = 0
) -> Iterator[tuple[str, int]]:
    """List the runs that are still to be made: scenario by scenario, in turns.

    Args:
        lines: Of runs that were made.
        wanted: Runs of each scenario.
        first_seed: Of each.
    """
    done = {(line["scenario"], line["seed"]) for line in lines}
    for number in range(max(wanted.values(), default=0)):
        for scenario, count in wanted.items():
            run = (scenario, first_seed + number)
            if number < count and run not in done:
                yield run
