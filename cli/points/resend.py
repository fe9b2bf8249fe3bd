"""`traverse points resend`: have a daemon publish points again."""

import json
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from traverse.cli.broker_options import BrokerOptions
from traverse.cli.control import send_command
from traverse.cli.options import Json
from traverse.cli.refusals import FAILED, refuse
from traverse.plurals import counted

LAST = 2**53 - 1

FromOption = Annotated[int, typer.Option("--from", min=0, help="First number.")]
ToOption = Annotated[
    int | None, typer.Option("--to", min=0, help="Last number; else the newest.")
]


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
    from traverse.protocol.messages import ResendArgs  # noqa: PLC0415

    try:
        args = ResendArgs(session=session, scan=scan, from_seq=from_seq, to_seq=to_seq)
    except ValueError:
        refuse(
            f"--to {to_seq} is below --from {from_seq}, --scan is given beside a "
            "session, or an option is invalid"
        )
    answer = send_command(arm, broker, lambda there: there.execute(args))
    typer.echo(json.dumps(answer) if as_json else "\n".join(_lines(answer)))
    asked = "points" if session is not None else "blocks" if scan is not None else ""
    if asked and not answer[asked]:
        raise typer.Exit(FAILED)


def _lines(answer: Mapping[str, Any]) -> list[str]:
    if "sessions" in answer:
        sessions = [
            f"{one['session']}  {one['first_seq']} to {one['last_seq']}"
            for one in answer["sessions"]
        ]
        return sessions + [
            f"{one['session']}  scan {one['scan']}" for one in answer["scans"]
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
