"""Options of commands that read an outbox."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.refusals import refuse

DbOption = Annotated[Path | None, typer.Option("--db", help="The outbox's file.")]
ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", help="The daemon's configuration, beside its state."),
]


def outbox_of(db: Path | None, config: Path | None) -> Path:
    """Find the outbox that is meant."""
    from traverse.daemon.state_dir import OUTBOX, state_path  # noqa: PLC0415

    if (db is None) == (config is None):
        refuse("give --db FILE or --config FILE, one of them")
    path = db or state_path(config or Path()) / OUTBOX
    if config is not None and not (config.is_file() or path.is_file()):
        refuse(f"{config}: there is no such file; check the path")
    return path
