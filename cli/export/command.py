"""`traverse export`: points and scans as files that other software reads."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from traverse.cli.options import Force, Json
from traverse.cli.refusals import check_target, refusals, refuse


def export(
    source: Annotated[
        Path,
        typer.Argument(
            help="A recording (.mcap), an outbox (.db), or points (.jsonl)."
        ),
    ],
    *,
    to: Annotated[
        str,
        typer.Option(help="csv, dxf, jsonl, npz, parquet, ply, text, xyz or campaign."),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(help="File to write (campaign: folder); else SOURCE's name."),
    ] = None,
    kind: Annotated[
        Literal["points", "scans"], typer.Option(help="Part of a recording.")
    ] = "points",
    coordinates: Annotated[
        Literal["centre", "surface", "part"],
        typer.Option(help="Of the ball, of the touched surface, or in the part."),
    ] = "centre",
    session: Annotated[
        str | None, typer.Option(help="Only points of this session.")
    ] = None,
    filters: Annotated[
        Path | None,
        typer.Option(
            help="TOML file with [[filters]], as [[scan.filters]] of a daemon."
        ),
    ] = None,
    template: Annotated[
        str, typer.Option(help="With --to text: such as '{seq};{x_mm:.3f}\\n'.")
    ] = "",
    arm: Annotated[
        Path | None, typer.Option(help="With --to campaign: the arm file.")
    ] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="With --to campaign: a campaign.toml, or its folder."),
    ] = None,
    retracted: Annotated[
        bool, typer.Option("--retracted", help="Retracted points and retractions, too.")
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Turn points, or the scans of a recording, into a file.

    Retracted points are left out unless --retracted is given. The file
    appears whole or not at all, and replaces another with --force only.
    Exit status 2: a file or an option was refused.
    """
    from traverse.cli.export.campaign import (  # noqa: PLC0415
        campaign_words,
        export_campaign,
    )
    from traverse.cli.export.file import (  # noqa: PLC0415
        Wanted,
        file_words,
        write_file,
    )
    from traverse.client.exports.formats import FORMATS  # noqa: PLC0415 - keeps --help quick

    if to not in (*FORMATS, "campaign"):
        refuse(f"--to {to}: one of {', '.join(FORMATS)}, campaign")
    with refusals(ValueError):
        if to == "campaign":
            if arm is None or campaign is None:
                refuse("--to campaign needs --arm and --campaign")
            folder = out or source.with_suffix("")
            report = export_campaign(source, arm, campaign, folder, session)
            said = campaign_words(report)
        else:
            path = out or source.with_suffix(f".{'txt' if to == 'text' else to}")
            if path.exists() and source.exists() and path.samefile(source):
                refuse(f"{path} is the source; name another with --out")
            check_target(path, force=force)
            wanted = Wanted(
                to, kind, coordinates, session, filters, template, retracted
            )
            report = write_file(source, path, wanted)
            said = file_words(source, report)
    if as_json:
        typer.echo(json.dumps(report, indent=1))
    else:
        typer.echo("\n".join(said), err=True)
