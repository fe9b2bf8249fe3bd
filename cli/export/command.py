"""`traverse export`: points and scans as files that other software reads."""

import json
from pathlib import Path

import typer

from traverse.cli.common.options import Force, Json
from traverse.cli.common.refusals import check_target, refusals, refuse
from traverse.cli.export.options import ExportOptions


def export(
    source: Path,
    *,
    export_options: ExportOptions,
    out: Path | None = None,
    arm: Path | None = None,
    campaign: Path | None = None,
    allow: str = "surface_unknown,empirical",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Turn points, or the scans of a recording, into a file.

    Retracted points are left out unless --retracted is given. The file
    appears whole or not at all, and replaces another with --force only.

    Args:
        source: A recording (.mcap), an outbox (.db), or points (.jsonl).
        out: File to write (campaign: folder); else SOURCE's name.
        arm: With --to campaign: the arm file.
        campaign: With --to campaign: a campaign.toml, or its folder.
        allow: With --to campaign: quality flags that a point may have, with commas.
    """
    from traverse.cli.common.point_flags import FlaggedPoints, allowed_flags
    from traverse.cli.export import campaign as labelled
    from traverse.cli.export.file import file_words, write_file
    from traverse.client.exports.formats import format_names

    to = export_options.to
    if to not in (*format_names(), "campaign"):
        refuse(f"--to {to}: one of {', '.join(format_names())}, campaign")
    with refusals(ValueError):
        if to == "campaign":
            if arm is None or campaign is None:
                refuse("--to campaign needs --arm and --campaign")
            folder = out or source.with_suffix("")
            flagged = FlaggedPoints(allowed_flags(allow))
            report = labelled.export_campaign(
                *(source, arm, campaign, folder),
                session=export_options.session,
                flagged=flagged,
            )
            lines = labelled.campaign_words(report, flagged)
        else:
            ending = {"text": "txt", "ros2": "ros2.mcap"}.get(to, to)
            path = out or source.with_suffix(f".{ending}")
            if path.exists() and source.exists() and path.samefile(source):
                refuse(f"{path} is the source; name another with --out")
            check_target(path, force=force)
            report = write_file(source, path, export_options)
            lines = file_words(source, report)
    if as_json:
        typer.echo(json.dumps(report, indent=1))
    else:
        typer.echo("\n".join(lines), err=True)
