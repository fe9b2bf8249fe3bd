"""`traverse fleet`: all arms of a store."""

import time
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.campaign_inputs import Family, PriorPatterns, check_prior
from traverse.cli.common.options import CommandGroup, HoldoutBy, Json, Operator
from traverse.cli.common.refusals import FAILED, print_report, refusals, refuse
from traverse.fleet.database import (
    BadValueError,
    Database,
    StoreAwayError,
    StoreRefusedError,
)
from traverse.fleet.opening import open_database
from traverse.fleet.tables import migrate
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.lab.diagnosis.model.result import DiagnosisOptions
    from traverse.lab.identification.identify import Options

fleet = CommandGroup("fleet", help="All arms of a store.")

STORE_ERRORS = StoreRefusedError, StoreAwayError, BadValueError

DatabaseOption = Annotated[
    str, typer.Option(help="As of `traverse store`: a file, or postgresql://...")
]


@fleet.command("add")
def add(
    files: list[Path],
    *,
    database: DatabaseOption = "traverse-store.db",
    as_json: Json = False,
) -> None:
    """Bring certificates and daily checks into a store; each counts once.

    A verification is checked first: its digests, and its figures from its data. Exit
    status 2: a file was refused; those before it are stored.

    Args:
        files: Folders of verifications, or histories of daily checks (interim.db).
    """
    from traverse.fleet.evidence import add_evidence
    from traverse.lab.daily_check.history import HistoryRefusedError

    with refusals(*STORE_ERRORS, HistoryRefusedError):
        store = _opened(database)
        entries = [
            {"file": str(path), "holds": add_evidence(store, path)} for path in files
        ]
    lines = [f"{entry['file']}: {entry['holds']}" for entry in entries]
    print_report({"added": entries}, lines, as_json=as_json)


@fleet.command("overview")
def overview(
    *,
    database: DatabaseOption = "traverse-store.db",
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    every_s: Annotated[int | None, typer.Option(min=1)] = None,
    as_json: Json = False,
) -> None:
    """Show all arms: state, daily checks, temperature, points, those in need first.

    Exit status 1: an arm is silent, alarmed, out of control or rejected, or has lost
    points.

    Args:
        out: Write a page, in one file.
        every_s: Write it anew so often, until Ctrl-C [s].
    """
    from traverse.fleet.overview import overview_page, overview_values
    from traverse.strict_toml.writing import write_atomically

    with refusals(*STORE_ERRORS):
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
        f"{arm['arm']}: {arm['state']}, "
        f"{counted(arm['points_a_day'][-1], 'point')} today"
        + "".join(f"; {concern}" for concern in arm["concerns"])
        for arm in arms
    ]
    lines += [f"wrote {out}"] if out is not None else []
    print_report(values, lines or ["no arms yet"], as_json=as_json)
    if any(arm["need"] == "bad" for arm in arms):
        raise typer.Exit(FAILED)


CampaignFolders = Annotated[
    list[Path], typer.Argument(help="Folders with campaign.toml.")
]


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Folder of results, files beside the campaigns, and workers.

    Attributes:
        out: Folder for the results, NAME/ each.
        processes: Processes of this computer; default one a core.
        scheduler: Dask scheduler, tcp://HOST:PORT or tls://, instead.
        rest: Leave out what has results; else refused.
    """

    out: Annotated[Path, typer.Option("--out", "-o")]
    family: Family = None
    prior: PriorPatterns = None
    processes: Annotated[int | None, typer.Option(min=1)] = None
    scheduler: str | None = None
    rest: bool = False
    operator: Operator = None


@fleet.command("identify")
def identify(
    campaigns: CampaignFolders,
    *,
    arm: Path,
    hold: list[str] | None = None,
    free: list[str] | None = None,
    run: RunOptions,
    as_json: Json = False,
) -> None:
    """Identify arms of one design, each from its campaign, many at once.

    A folder of results each, as of `traverse identify`. Exit status 1: a campaign
    failed, did not converge, or contradicts a certificate.

    Args:
        arm: Arm file of the design.
        hold: As of `traverse identify`.
        free: As of `traverse identify`.
    """
    from traverse.lab.identification.identify import Options

    options = Options(hold=tuple(hold or ()), free=tuple(free or ()))
    _run(campaigns, arm, options, run, as_json=as_json)


@fleet.command("diagnose")
def diagnose(
    campaigns: CampaignFolders,
    *,
    arm: Path,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    holdout_by: HoldoutBy = "time",
    run: RunOptions,
    as_json: Json = False,
) -> None:
    """Find what the models of many arms lack, each from its campaign.

    A folder of results each, as of `traverse diagnose`. Exit status 1: one failed.

    Args:
        arm: Arm file of the design, or folder of results, NAME/ each.
        seed: As of `traverse diagnose`.
    """
    from traverse.lab.diagnosis.model.result import DiagnosisOptions

    options = DiagnosisOptions(seed=seed, holdout_by=holdout_by)
    _run(campaigns, arm, options, run, as_json=as_json)


def _run(
    folders: list[Path],
    arm: Path,
    options: "Options | DiagnosisOptions",
    run: RunOptions,
    *,
    as_json: bool,
) -> None:
    from traverse.fleet.campaigns import (
        Request,
        check_request,
        results_of,
        run_campaigns,
    )
    from traverse.fleet.workers import Workers, WorkersError

    with refusals(ValueError, WorkersError):
        check_prior(run.family, run.prior)
        prior = tuple(run.prior or ())
        request = Request(arm, run.family, prior, options, run.out, run.operator)
        if run.rest:
            folders = [
                folder for folder in folders if not results_of(folder, run.out).exists()
            ]
        check_request(folders, request)
        outcomes = []
        workers = Workers(run.processes, run.scheduler)
        for outcome in run_campaigns(folders, request, workers):
            outcomes.append(outcome)
            text = (
                f"{len(outcomes)} of {len(folders)}: {outcome.name}: {outcome.verdict}"
            )
            typer.echo(text, err=True)
    outcomes.sort(key=attrgetter("name"))
    values = {
        "schema": "traverse/fleet-run/1",
        "out": str(run.out),
        "campaigns": [
            {"name": ended.name, "failed": ended.failed, "verdict": ended.verdict}
            for ended in outcomes
        ],
    }
    n_failed = sum(ended.failed for ended in outcomes)
    lines = [
        f"{counted(len(outcomes) - n_failed, 'campaign')} done, {n_failed} failed; "
        f"wrote {run.out}"
    ]
    print_report(values, lines, as_json=as_json)
    if not all(ended.good for ended in outcomes):
        raise typer.Exit(FAILED)


@fleet.command("family")
def family(
    results: list[Path],
    *,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    as_json: Json = False,
) -> None:
    """Compare arms of one type: mean and spread of each parameter, and who leaves them.

    Exit status 1: an arm is farther from its family than one in a hundred families has
    by chance.

    Args:
        results: Folders of `traverse identify`, of arms of one design.
        out: File of it, for `identify --family`.
    """
    from traverse.lab.identification.family import (
        family_lines,
        family_values,
        read_family,
        write_family,
    )

    with refusals(ValueError):
        values = family_values(read_family(results))
        lines = family_lines(values)
        if out is not None:
            write_family(values, out)
            lines.append(f"wrote {out}")
    print_report(values, lines, as_json=as_json)
    if values["alarms"]:
        raise typer.Exit(FAILED)


def _opened(database: str) -> Database:

    store = open_database(database)
    migrate(store)
    return store
