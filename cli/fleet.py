"""`traverse fleet`: all arms of a store."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.options import Json
from traverse.cli.refusals import FAILED, print_report, refusals, refuse
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.fleet.database import Database

fleet = typer.Typer(help="All arms of a store.", no_args_is_help=True)

DatabaseOption = Annotated[
    str, typer.Option(help="As of `traverse store`: a file, or postgresql://...")
]


@fleet.command("add")
def add(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Folders of verifications, or histories of daily checks (interim.db)."
        ),
    ],
    *,
    database: DatabaseOption = "traverse-store.db",
    as_json: Json = False,
) -> None:
    """Bring certificates and daily checks into a store; each counts once.

    A verification is checked first: its digests, and its figures from its data. Exit
    status 2: a file was refused; those before it are stored.
    """
    from traverse.fleet.evidence import add_evidence  # noqa: PLC0415 - keeps --help quick
    from traverse.lab.daily_check.history import HistoryRefusedError  # noqa: PLC0415

    with refusals(*_store_errors(), HistoryRefusedError):
        store = _opened(database)
        found = [
            {"file": str(path), "holds": add_evidence(store, path)} for path in files
        ]
    lines = [f"{one['file']}: {one['holds']}" for one in found]
    print_report({"added": found}, lines, as_json=as_json)


@fleet.command("overview")
def overview(
    *,
    database: DatabaseOption = "traverse-store.db",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write a page, in one file.")
    ] = None,
    every_s: Annotated[
        int | None,
        typer.Option(min=1, help="Write it anew so often, until Ctrl-C [s]."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show all arms: state, daily checks, temperature, points, those in need first.

    Exit status 1: an arm is silent, alarmed, out of control or rejected, or has lost
    points.
    """
    from traverse.fleet.overview import overview_page, overview_values  # noqa: PLC0415 - keeps --help quick
    from traverse.strict_toml.writing import write_atomically  # noqa: PLC0415

    with refusals(*_store_errors()):
        if "://" not in database and not Path(database).is_file():
            refuse(f"{database}: no such file; `traverse store` makes one")
        store = _opened(database)
        while True:
            values, reports = overview_values(store)
            if out is not None:
                write_atomically(out, overview_page(values, reports, every_s))
            if every_s is None or out is None:
                break
            time.sleep(every_s)
    arms = values["arms"]
    lines = [
        f"{one['arm']}: {one['state']}, "
        f"{counted(one['points_a_day'][-1], 'point')} today"
        + "".join(f"; {concern}" for concern in one["concerns"])
        for one in arms
    ]
    lines += [f"wrote {out}"] if out is not None else []
    print_report(values, lines or ["no arms yet"], as_json=as_json)
    if any(one["need"] == "bad" for one in arms):
        raise typer.Exit(FAILED)


@fleet.command("family")
def family(
    results: Annotated[
        list[Path],
        typer.Argument(help="Folders of `traverse identify`, of arms of one design."),
    ],
    *,
    as_json: Json = False,
) -> None:
    """Compare arms of one type: mean and spread of each parameter, and who leaves them.

    Exit status 1: an arm is farther from its family than one in a hundred families has
    by chance.
    """
    from traverse.lab.identification.family import (  # noqa: PLC0415 - keeps --help quick
        family_lines,
        family_values,
        read_family,
    )

    with refusals(ValueError):
        values = family_values(read_family(results))
    print_report(values, family_lines(values), as_json=as_json)
    if values["alarms"]:
        raise typer.Exit(FAILED)


def _store_errors() -> tuple[type[Exception], ...]:
    from traverse.fleet.database import BadValueError, StoreAwayError, StoreRefusedError  # noqa: PLC0415

    return StoreRefusedError, StoreAwayError, BadValueError


def _opened(database: str) -> "Database":
    from traverse.fleet.database import open_database  # noqa: PLC0415
    from traverse.fleet.tables import migrate  # noqa: PLC0415

    store = open_database(database)
    migrate(store)
    return store
