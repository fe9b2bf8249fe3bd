"""`traverse simulate campaign` for programs that start modules."""

import argparse
import sys
from pathlib import Path

from traverse.simulator.campaigns.command import campaign_made


def main() -> int:
    parser = argparse.ArgumentParser("python -m traverse.simulator.campaigns")
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    arguments = parser.parse_args()
    return campaign_made(arguments.spec, arguments.out, arguments.seed)


if __name__ == "__main__":
    sys.exit(main())
