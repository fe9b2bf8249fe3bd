"""`traverse simulate`: the hardware, virtual."""

from pathlib import Path
from typing import Annotated

import typer


def simulate(
    config: Annotated[Path, typer.Option("--config", help="What to simulate (TOML).")],
) -> None:
    """Put virtual controller boards on ptys, with a virtual arm behind them."""
    from simulator.run import run_simulator  # noqa: PLC0415 - heavy; not for --help

    raise typer.Exit(run_simulator(config))
