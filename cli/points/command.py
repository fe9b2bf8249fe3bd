"""`traverse points`: what a daemon keeps on its disk."""

import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated

import typer

from traverse.cli.options import CommandGroup, Force
from traverse.cli.points.options import ConfigOption, DbOption, outbox_of
from traverse.cli.points.resend import LAST, FromOption, ToOption, resend
from traverse.cli.points.signing import key, verify
from traverse.cli.refusals import check_target, refusals, refuse
from traverse.plurals import counted

if TYPE_CHECKING:
    from sqlite3 import Connection

points = CommandGroup(help="Points on a daemon's disk.", no_args_is_help=True)
points.command("resend")(resend)
points.command("key")(key)
points.command("verify")(verify)


@points.command("list")
def list_points(
    *,
    db: DbOption = None,
    config: ConfigOption = None,
    session: str | None = None,
    from_seq: FromOption = 0,
    to_seq: ToOption = None,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """List sessions, or the points of one; beside a running daemon or without one.

    Args:
        session: List its points, not the sessions.
        as_json: One object a line.
    """
    from traverse.cli.points import outbox  # noqa: PLC0415
    from traverse.daemon.store import queries  # noqa: PLC0415

    with (
        refusals(ValueError),
        outbox.opened_outbox(outbox_of(db, config)) as connection,
    ):
        if session is None:
            for one in queries.read_sessions(connection, LAST):
                n, unsent = queries.counts_of(connection, one.session)
                typer.echo(outbox.session_line(one, n, unsent, as_json=as_json))
            return
        _check(connection, session)
        last = LAST if to_seq is None else to_seq
        for message in queries.iter_messages(connection, session, from_seq, last):
            typer.echo(outbox.point_line(message, as_json=as_json))


@points.command("export")
def export(
    *,
    db: DbOption = None,
    config: ConfigOption = None,
    session: str | None = None,
    from_seq: FromOption = 0,
    to_seq: ToOption = None,
    as_format: Annotated[str, typer.Option("--format")] = "csv",
    out: Path | None = None,
    force: Force = False,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Write points with all their values; retractions are rows too.

    Exit status 1: some could not be read.

    Args:
        session: Only this one; else all, oldest first.
        as_format: csv, or jsonl: one message a line.
        out: File to write; else standard output.
        as_json: With --out: report as JSON.
    """
    from traverse.cli.points import outbox  # noqa: PLC0415
    from traverse.daemon.store import queries  # noqa: PLC0415
    from traverse.strict_toml.writing import replacing  # noqa: PLC0415

    if as_format not in outbox.FORMATS:
        refuse(f"--format {as_format}: one of {', '.join(outbox.FORMATS)}")
    if as_json and out is None:
        refuse("--json needs --out; without it --format jsonl is JSON")
    last = LAST if to_seq is None else to_seq
    check_target(out, force=force)
    with refusals(ValueError), ExitStack() as stack:
        connection = stack.enter_context(outbox.opened_outbox(outbox_of(db, config)))
        if session is not None:
            _check(connection, session)
        file: IO[bytes] = sys.stdout.buffer
        if out is not None:
            file = stack.enter_context(replacing(out))
        names = [s.session for s in queries.read_sessions(connection, LAST)]
        messages = (
            message
            for name in (names if session is None else [session])
            for message in queries.iter_messages(connection, name, from_seq, last)
        )
        n, unreadable = outbox.write_points(messages, file, as_format)
    for text in unreadable:
        typer.echo(text, err=True)
    if as_json:
        report = {"file": str(out), "points": n, "unreadable": unreadable}
        typer.echo(json.dumps(report, indent=1))
    elif out is not None:
        typer.echo(f"{out}: {counted(n, 'point')}", err=True)
    if unreadable:
        raise typer.Exit(1)


def _check(connection: "Connection", session: str) -> None:
    """End the command where the outbox has nothing of a session."""
    from traverse.daemon.store import queries  # noqa: PLC0415

    if not queries.read_messages(connection, session, 0, LAST, 1):
        refuse(
            f"there are no points of session {session!r}; `traverse points list` lists "
            "the sessions"
        )
