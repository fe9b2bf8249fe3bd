"""Make a campaign folder, as before `traverse simulate campaign`."""

import sys
from collections.abc import Sequence

from traverse.simulator.campaigns.command import campaign_made
from traverse.simulator.campaigns.old_command import run_old_command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; say what it is called now."""
    module, now = "traverse.simulator.campaigns", "traverse simulate campaign"
    return run_old_command(module, now, campaign_made, arguments)


if __name__ == "__main__":
    sys.exit(main())
