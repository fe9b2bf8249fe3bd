"""Make a dense scan, as before `traverse simulate scan`: kept for one release.

`python -m traverse.simulator.campaigns.dense SPEC.toml --out DIR`
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from traverse.simulator.campaigns.command import scan_made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; say what it is called now."""
    program = "python -m traverse.simulator.campaigns.dense"
    parser = argparse.ArgumentParser(prog=program)
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    given = parser.parse_args(arguments)
    if given.seed is not None and given.seed < 0:
        parser.error(f"--seed {given.seed} is negative; expected 0 or more")
    now = f"{program}: is `traverse simulate scan` from this release on"
    print(now, file=sys.stderr)  # noqa: T201 - for people who type it
    return scan_made(given.spec, given.out, given.seed)


if __name__ == "__main__":
    sys.exit(main())
