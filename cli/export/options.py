"""Options of `traverse export` that say what is written."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from traverse.cli.options import with_options
from traverse.cli.qif_check import QifSchemas


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """The options, in the order of `--help`; `with_wanted` gives them to `export`."""

    to: Annotated[
        str,
        typer.Option(
            help="csv, dxf, jsonl, npz, parquet, ply, qif, text, xyz or campaign."
        ),
    ] = "csv"
    kind: Annotated[
        Literal["points", "scans"], typer.Option(help="Part of a recording.")
    ] = "points"
    coordinates: Annotated[
        Literal["centre", "surface", "part"],
        typer.Option(help="Of the ball, of the touched surface, or in the part."),
    ] = "centre"
    session: Annotated[
        str | None, typer.Option(help="Only points of this session.")
    ] = None
    filters: Annotated[
        Path | None,
        typer.Option(
            help="TOML file with [[filters]], as [[scan.filters]] of a daemon."
        ),
    ] = None
    template: Annotated[
        str, typer.Option(help="With --to text: such as '{seq};{x_mm:.3f}\\n'.")
    ] = ""
    retracted: Annotated[
        bool, typer.Option("--retracted", help="Retracted points and retractions, too.")
    ] = False
    schemas: QifSchemas = None


with_wanted = with_options("wanted", Wanted)
