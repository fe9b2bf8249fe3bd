"""`traverse simulate`: the hardware, virtual."""

from pathlib import Path

import typer


def simulate(
    *,
    config: Path,
) -> None:
    """Simulate the devices of a virtual arm on ptys and CAN.

    Prints a line "ready <device> <path>" for each. Ends on SIGTERM or Ctrl-C, or at the
    end of its script if configured. Exit status 2: the configuration
    or the arm file was refused.

    Args:
        config: The simulator's configuration, TOML.
    """
    from traverse.simulator.run import run_simulator  # heavy; not for --help

    raise typer.Exit(run_simulator(config))
