"""`python -m traverse.simulator.campaigns` and `.dense`: kept for one release.

They were the commands before `traverse simulate campaign` and `traverse simulate scan`.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path


def run_old_command(
    module: str,
    now: str,
    make: Callable[[Path, Path, int | None], int],
    arguments: Sequence[str] | None,
) -> int:
    """Parse the old arguments, say what the command is called now, and run it."""
    program = f"python -m {module}"
    parser = argparse.ArgumentParser(prog=program)
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    given = parser.parse_args(arguments)
    if given.seed is not None and given.seed < 0:
        parser.error(f"--seed {given.seed} is negative; expected 0 or more")
    message = f"{program}: is `{now}` from this release on"
    print(message, file=sys.stderr)  # noqa: T201 - for people who type it
    return make(given.spec, given.out, given.seed)
