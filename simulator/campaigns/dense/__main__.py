"""Make a dense scan, as before `traverse simulate scan`."""

import sys
from collections.abc import Sequence

from traverse.simulator.campaigns.command import scan_made
from traverse.simulator.campaigns.old_command import run_old_command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; say what it is called now."""
    module, now = "traverse.simulator.campaigns.dense", "traverse simulate scan"
    return run_old_command(module, now, scan_made, arguments)


if __name__ == "__main__":
    sys.exit(main())
