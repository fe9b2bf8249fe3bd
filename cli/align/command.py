"""`traverse align`: place of the part, its uncertainty, and its use."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.align.options import AlignmentOptions
from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Json
from traverse.cli.common.refusals import (
    check_inputs,
    end_by_state,
    print_report,
    refusals,
    refuse,
)
from traverse.cli.control import send_command


def align(
    points: Path | None = None,
    *,
    options: AlignmentOptions,
    strict: bool = False,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    as_json: Json = False,
    send: bool = False,
    clear: bool = False,
    arm_name: str | None = None,
    broker: BrokerOptions,
) -> None:
    """Compute where the part is, and how well that is known.

    Exit status 1: a test failed, nothing is sent then; 2: refused, among others where
    the points do not determine it; 3: daemon or broker could not be reached.

    Args:
        points: Points (JSON lines, CSV, recording, outbox), a campaign's folder; or an
            alignment.json to send.
        strict: Exit status 4 where it is in doubt.
        out: Folder for alignment.json and .html.
        send: Have the daemon use it, if no test failed.
        clear: Have the daemon use none from now on.
        arm_name: The arm to send to; else the points' arm.
    """
    if clear:
        send_command(arm_name, broker, lambda arm: arm.clear_alignment())
        typer.echo("points have no part coordinates")
        return
    if points is None:
        refuse("name the points to be aligned, or give --clear")
    check_inputs(points, options.nominal, options.arm)
    from traverse.lab.alignment import files

    with refusals():
        if options.problem is not None:
            refuse(options.problem)
        if options.nominal is not None:
            from traverse.cli.align.computing import compute_alignment

            with refusals(ValueError):
                values = compute_alignment(points, options.nominal, options)
        elif send:  # one that was computed before
            values = files.read_alignment(points)
        else:
            refuse("--nominal missing; or give an alignment.json and --send")
        if out is not None:
            files.write_alignment(values, out)
    wrote = f"wrote {out}: alignment.json, alignment.html"
    lines = [*files.WORDS.lines("summary", values), *([] if out is None else [wrote])]
    print_report(values, lines, as_json=as_json)
    end_by_state(values["state"], strict=strict)
    if send:
        to = arm_name or values["arm"]
        if to is None:
            refuse("the points do not name their arm; give --arm-name")
        send_command(to, broker, lambda arm: arm.execute(files.align_args(values)))
        typer.echo(f"{to} uses it from now on", err=True)
