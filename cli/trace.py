"""`traverse trace`: the chain of evidence behind a file."""

import os
from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import FAILED, print_report, refusals
from traverse.cli.points.command import read_public_key_file


def trace(
    file: Path,
    *,
    where: Annotated[
        list[Path] | None, typer.Option("--in", exists=True, file_okay=False)
    ] = None,
    key: Path | None = None,
    as_json: Json = False,
) -> None:
    """Show the chain of evidence behind a file.

    What it follows from, and what of that is missing or altered. Exit status 1:
    something is missing or altered.

    Args:
        file: Results, a campaign, an arm file, a recording, or points (.jsonl).
        where: Folder where other files of the chain are. Repeatable; those around the
            file are looked at anyhow.
        key: Public key of the arm, by which points are checked.
    """
    with refusals():
        from traverse.lab.certificates.trace import Tracer

        # Path.resolve raises RuntimeError where a link leads to itself.
        beside = Path(os.path.realpath(file)).parent
        around = [beside] if file.is_dir() else [beside, beside.parent]
        public_key = None if key is None else read_public_key_file(key)
        trail = Tracer([*around, *(where or [])], public_key).trace(file)
        states = [link.state for link in trail.every()]
        bad = [
            f"{states.count(state)} {state}"
            for state in ("altered", "missing", "not stated")
            if state in states
        ]
        verdict = ", ".join(bad) or "the chain is whole"
        print_report(trail.values, [*trail.lines(), verdict], as_json=as_json)
    if {"altered", "missing"} & set(states):
        raise typer.Exit(FAILED)
