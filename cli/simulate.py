"""`traverse simulate`: the hardware, virtual; campaigns and scans without any."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import CommandGroup
from traverse.cli.common.refusals import check_inputs

simulate = CommandGroup(
    "simulate", help="Simulate an arm's devices, a campaign, or a dense scan."
)

Out = Annotated[Path, typer.Option("--out", "-o", help="Folder to write.")]
Seed = Annotated[
    int | None, typer.Option(min=0, help="In place of the specification's.")
]


@simulate.command()
def devices(config: Path) -> None:
    """Simulate the devices of a virtual arm on ptys and CAN.

    Prints a line "ready <device> <path>" for each. Ends on SIGTERM or Ctrl-C, or at the
    end of its script if configured. Exit status 2: the configuration
    or the arm file was refused.

    Args:
        config: The simulator's configuration, TOML.
    """
    from traverse.simulator.run import run_simulator  # heavy; not for --help

    raise typer.Exit(run_simulator(config))


@simulate.command()
def campaign(specification: Path, *, out: Out, seed: Seed = None) -> None:
    """Make an identification campaign: campaign.toml and poses.csv.

    Beside them are arm.toml with the design values, and a folder truth.

    Args:
        specification: What is touched, and what disturbs it, TOML.
    """
    check_inputs(specification)
    from traverse.simulator.campaigns.command import campaign_made

    raise typer.Exit(campaign_made(specification, out, seed))


@simulate.command()
def scan(specification: Path, *, out: Out, seed: Seed = None) -> None:
    """Make a dense scan: campaign.toml and scan.mcap.

    Beside them are arm.toml with the design values, and truth/arm.toml with the true
    ones.

    Args:
        specification: What is touched, and how the arm moves, TOML.
    """
    check_inputs(specification)
    from traverse.simulator.campaigns.command import scan_made

    raise typer.Exit(scan_made(specification, out, seed))
