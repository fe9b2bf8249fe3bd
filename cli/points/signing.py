"""`traverse points key` and `points verify`: points signed by their arm."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.options import Json
from traverse.cli.points.options import ConfigOption, DbOption, outbox_of
from traverse.cli.points.resend import LAST
from traverse.cli.refusals import (
    FAILED,
    check_target,
    print_report,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.protocol.messages import Point


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
    from base64 import b64encode  # noqa: PLC0415
    from os import O_CREAT, O_EXCL, O_WRONLY, fdopen, open  # noqa: PLC0415

    check_target(out, force=False)
    with refusals():
        from cryptography.hazmat.primitives.asymmetric.ed25519 import (  # noqa: PLC0415
            Ed25519PrivateKey,
        )
        from cryptography.hazmat.primitives.serialization import (  # noqa: PLC0415
            Encoding,
            NoEncryption,
            PrivateFormat,
        )

        made = Ed25519PrivateKey.generate()
        with fdopen(open(out, O_WRONLY | O_CREAT | O_EXCL, 0o600), "wb") as file:
            file.write(
                made.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
            )
        public = b64encode(made.public_key().public_bytes_raw()).decode()
        beside = out.with_name(f"{out.name}.pub")
        beside.write_text(f"{public}\n", "utf-8")
    report = {"key": str(out), "public": str(beside), "public_key": public}
    lines = [f"wrote {out}, for the daemon only", f"wrote {beside}: {public}"]
    print_report(report, lines, as_json=as_json)


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
    from traverse.cli.points.outbox import opened_outbox, point_of  # noqa: PLC0415
    from traverse.daemon.store.queries import iter_messages, read_sessions  # noqa: PLC0415
    from traverse.protocol.signed_points import (  # noqa: PLC0415
        checked_points,
        points_of_lines,
    )
    from traverse.strict_toml.files import table_lines  # noqa: PLC0415

    public_key = read_public_key_file(public)
    with refusals(ValueError), ExitStack() as stack:
        stored: Iterator[Point | str]
        if file is not None:
            stored = points_of_lines(stack.enter_context(table_lines(file)))
        else:
            connection = stack.enter_context(opened_outbox(outbox_of(db, config)))
            stored = (
                point_of(message)
                for session in read_sessions(connection, LAST)
                for message in iter_messages(connection, session.session, 0, LAST)
            )
        found = checked_points(stored, public_key)
    lasts = [f"session {name}: up to point {seq}" for name, seq in found.last.items()]
    verdict = (
        counted(len(found.problems), "problem")
        if found.problems
        else f"{counted(found.n_points, 'point')}: signed, none altered or missing; "
        "whether any is missing behind the last of a session is not known"
    )
    values = {"points": found.n_points, "problems": found.problems, "last": found.last}
    print_report(values, [*found.problems, *lasts, verdict], as_json=as_json)
    if found.problems or not found.n_points:
        raise typer.Exit(FAILED)


def read_public_key_file(path: Path) -> bytes:
    """Read a public key; refuse what is none."""
    from traverse.protocol.signed_points import read_public_key  # noqa: PLC0415
    from traverse.strict_toml.files import text_of  # noqa: PLC0415

    try:
        with refusals():
            return read_public_key(text_of(path))
    except ValueError as error:
        refuse(
            f"{path}: is no public key of an arm ({error}); it has `public_key` of the "
            "arm's status, and `traverse points key` writes it"
        )
