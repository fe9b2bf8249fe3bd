"""`traverse points`: the points on a daemon's disk."""

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated, Any

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import CommandGroup, Force, Json
from traverse.cli.common.refusals import (
    FAILED,
    check_target,
    print_report,
    refusals,
    refuse,
)
from traverse.cli.control import send_command
from traverse.plurals import counted
from traverse.strict_toml.files import text_lines, text_of

if TYPE_CHECKING:
    from sqlite3 import Connection

    from traverse.protocol.messages import Point


points = CommandGroup("points", help="Points on a daemon's disk.")

LAST = 2**53 - 1

FromOption = Annotated[int, typer.Option("--from", min=0, help="First number.")]
ToOption = Annotated[
    int | None, typer.Option("--to", min=0, help="Last number; else the newest.")
]
DbOption = Annotated[Path | None, typer.Option("--db", help="The outbox's file.")]
ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config", "-c", help="The daemon's configuration, beside its state."
    ),
]


@points.command("resend")
def resend(
    session: str | None = None,
    *,
    scan: str | None = None,
    arm: str,
    broker: BrokerOptions,
    from_seq: FromOption = 0,
    to_seq: ToOption = None,
    as_json: Json = False,
) -> None:
    """Have the daemon publish points again, with the same ids, to all who listen.

    Or, with --scan, the blocks of a scan that points from --from to --to are in.

    Exit status 1: it has none of them.

    Args:
        session: Session of the points; without it, list sessions.
        scan: Blocks of this scan instead of points.
        arm: Name of the arm.
    """
    from traverse.protocol.messages import ResendArgs

    try:
        args = ResendArgs(session=session, scan=scan, from_seq=from_seq, to_seq=to_seq)
    except ValueError:
        refuse(
            f"--to {to_seq} is below --from {from_seq}, --scan is given beside a "
            "session, or an option is invalid"
        )
    answer = send_command(arm, broker, lambda client: client.execute(args))
    typer.echo(json.dumps(answer) if as_json else "\n".join(_lines(answer)))
    counted_unit = (
        "points" if session is not None else "blocks" if scan is not None else ""
    )
    if counted_unit and not answer[counted_unit]:
        raise typer.Exit(FAILED)


def _lines(answer: Mapping[str, Any]) -> list[str]:
    if "sessions" in answer:
        sessions = [
            f"{held['session']}  {held['first_seq']} to {held['last_seq']}"
            for held in answer["sessions"]
        ]
        return sessions + [
            f"{scan['session']}  scan {scan['scan']}" for scan in answer["scans"]
        ]
    if "scan" in answer:
        if not answer["blocks"]:
            return [f"the daemon has nothing of that of scan {answer['scan']}"]
        return [
            f"sent again: {counted(answer['blocks'], 'block')} of scan "
            f"{answer['scan']}; the "
            f"daemon has points {answer['first_seq']} to {answer['last_seq']}"
        ]
    if answer["last_seq"] is None:
        return [f"the outbox has no points of session {answer['session']}"]
    return [
        f"sent again: {counted(answer['points'], 'point')} of session "
        f"{answer['session']}; the outbox has {answer['first_seq']} to "
        f"{answer['last_seq']}"
    ]


@points.command("key")
def key(
    *,
    out: Path,
    as_json: Json = False,
) -> None:
    """Make the key by which a daemon signs points, and beside it the public one.

    The private key stays on the arm's computer; `key` of [signing] names it.

    Args:
        out: File of the private key; new.
    """
    from base64 import b64encode
    from os import O_CREAT, O_EXCL, O_WRONLY, fdopen, open

    check_target(out, force=False)
    with refusals():
        from cryptography.hazmat.primitives.asymmetric.ed25519 import (
            Ed25519PrivateKey,
        )
        from cryptography.hazmat.primitives.serialization import (
            Encoding,
            NoEncryption,
            PrivateFormat,
        )

        private_key = Ed25519PrivateKey.generate()
        with fdopen(open(out, O_WRONLY | O_CREAT | O_EXCL, 0o600), "wb") as file:
            file.write(
                private_key.private_bytes(
                    Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
                )
            )
        public = b64encode(private_key.public_key().public_bytes_raw()).decode()
        beside = out.with_name(f"{out.name}.pub")
        beside.write_text(f"{public}\n", "utf-8")
    report = {"key": str(out), "public": str(beside), "public_key": public}
    lines = [f"wrote {out}, for the daemon only", f"wrote {beside}: {public}"]
    print_report(report, lines, as_json=as_json)


@points.command("verify")
def verify(
    file: Path | None = None,
    *,
    public: Annotated[Path, typer.Option("--key")],
    db: DbOption = None,
    config: ConfigOption = None,
    as_json: Json = False,
) -> None:
    """Check signed points: none removed, altered, inserted or moved.

    Exit status 1: something is wrong, line by line.

    Args:
        file: Points as JSON lines; else --db or --config.
        public: The arm's public key, that its owner gave you.
    """
    from traverse.cli.points.outbox import opened_outbox, point_of
    from traverse.daemon.store.queries import iter_messages, read_sessions
    from traverse.protocol.signed_points import (
        checked_points,
        points_of_lines,
    )

    public_key = read_public_key_file(public)
    with refusals(ValueError), ExitStack() as stack:
        stored: Iterator[Point | str]
        if file is not None:
            stored = points_of_lines(stack.enter_context(text_lines(file)))
        else:
            connection = stack.enter_context(opened_outbox(outbox_of(db, config)))
            stored = (
                point_of(message)
                for session in read_sessions(connection, LAST)
                for message in iter_messages(connection, session.session, 0, LAST)
            )
        check = checked_points(stored, public_key)
    lasts = [f"session {name}: up to point {seq}" for name, seq in check.last.items()]
    verdict = (
        counted(len(check.problems), "problem")
        if check.problems
        else f"{counted(check.n_points, 'point')}: signed, none altered or missing; "
        "whether any is missing behind the last of a session is not known"
    )
    values = {"points": check.n_points, "problems": check.problems, "last": check.last}
    print_report(values, [*check.problems, *lasts, verdict], as_json=as_json)
    if check.problems or not check.n_points:
        raise typer.Exit(FAILED)


def read_public_key_file(path: Path) -> bytes:
    from traverse.protocol.signed_points import read_public_key

    try:
        with refusals():
            return read_public_key(text_of(path))
    except ValueError as error:
        refuse(
            f"{path}: is no public key of an arm ({error}); it has `public_key` of the "
            "arm's status, and `traverse points key` writes it"
        )


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
    from traverse.cli.points import outbox
    from traverse.daemon.store import queries

    path = outbox_of(db, config)
    with refusals(ValueError), outbox.opened_outbox(path) as connection:
        if session is None:
            for held in queries.read_sessions(connection, LAST):
                n, unsent = queries.counts_of(connection, held.session)
                typer.echo(outbox.session_line(held, n, unsent, as_json=as_json))
            return
        _check(connection, session)
        last = LAST if to_seq is None else to_seq
        doubts = outbox.doubts_beside(path)
        for message in queries.iter_messages(connection, session, from_seq, last):
            typer.echo(outbox.point_line(message, doubts, as_json=as_json))


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
    from traverse.cli.points import outbox
    from traverse.daemon.store import queries
    from traverse.strict_toml.writing import replacing

    if as_format not in outbox.FORMATS:
        refuse(f"--format {as_format}: one of {', '.join(outbox.FORMATS)}")
    if as_json and out is None:
        refuse("--json needs --out; without it --format jsonl is JSON")
    last = LAST if to_seq is None else to_seq
    path = outbox_of(db, config)
    check_target(out, force=force)
    with refusals(ValueError), ExitStack() as stack:
        connection = stack.enter_context(outbox.opened_outbox(path))
        doubts = outbox.doubts_beside(path)
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
        n, unreadable = outbox.write_points(messages, doubts, file, as_format)
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
    from traverse.daemon.store import queries

    if not queries.read_messages(connection, session, 0, LAST, 1):
        refuse(
            f"there are no points of session {session!r}; `traverse points list` lists "
            "the sessions"
        )


def outbox_of(db: Path | None, config: Path | None) -> Path:
    from traverse.daemon.state_dir import OUTBOX, state_path

    if (db is None) == (config is None):
        refuse("give --db FILE or --config FILE, one of them")
    path = db or state_path(config or Path()) / OUTBOX
    if config is not None and not (config.is_file() or path.is_file()):
        refuse(f"{config}: there is no such file; check the path")
    return path
