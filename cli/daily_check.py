"""`traverse daily-check`: the daily two-minute check with a cone and a sphere."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Json
from traverse.cli.common.refusals import (
    FAILED,
    REFUSED,
    end,
    end_by_state,
    print_report,
    refusals,
    refuse,
)
from traverse.installation import missing

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.daily_check.history import Check
    from traverse.lab.daily_check.report import DailyCheckReport

HISTORY = "interim.db"
ALLOWED = frozenset({"surface_unknown", "empirical"})
LIBRARIES = ("scipy", "matplotlib", "jinja2", "mcap")  # that figures and charts need


def daily_check(
    *,
    arm: Path,
    config: Path | None = None,
    history: Path | None = None,
    radius: float | None = None,
    campaign: Path | None = None,
    show: bool = False,
    new_base: str | None = None,
    acceptance: Path | None = None,
    limits: Path | None = None,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    strict: bool = False,
    broker: BrokerOptions,
    as_json: Json = False,
) -> None:
    """Check the arm with a cone and a sphere; show the trend.

    Guided as `traverse collect` is; figures go into a history, and control charts of
    it warn when the arm drifts.

    Where the libraries for the figures are missing it says so first; what is touched
    is kept, and --campaign computes it later, here or on another computer.

    Exit status 1: out of control, beyond a limit, not plausible, or not everything was
    touched; 2: also if nothing could be computed; 4: --strict, and it is not judged
    yet or not comparable.

    Args:
        arm: The arm file that the daemon uses.
        config: The daemon's configuration: its state folder has the history.
        history: The history instead, a file (SQLite).
        radius: Calibrated radius of the sphere in mm; else as last time.
        campaign: Folder of a check that was collected; counts once.
        show: Check nothing; show the history.
        new_base: Start new charts with this check, for this reason.
        acceptance: certificate.json of the last acceptance.
        limits: Permitted errors, as for `verify`.
        out: Folder for chart.png, .html.
        strict: Exit status 4 if the result is in doubt.
    """
    import sqlite3

    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.lab.daily_check.history import (
        HistoryRefusedError,
        add_check,
        checks_of,
        judged_with,
    )

    with refusals(HistoryRefusedError, sqlite3.Error):
        lacking = _lacking()
        if lacking is not None and (show or campaign is not None):
            end(REFUSED, lacking)
        address = broker.address()
        model = read_arm(arm)
        path = _history(config, history)
        before = checks_of(path, model.name)
        check = None
        if not show:
            folder = campaign
            if folder is None:
                mm = radius or (before[-1].figures.sphere_radius_mm if before else 0)
                repeat_command = (
                    f"traverse daily-check --arm {arm} "
                    + (f"--config {config}" if config else f"--history {history}")
                    + " --campaign"
                )
                if lacking is not None:
                    typer.echo(
                        f"{lacking}. Nothing can be judged before: what is touched "
                        "now is kept, to be computed later, here or on another "
                        "computer (q ends)",
                        err=True,
                    )
                folder = _collected(
                    path, model, mm, address, repeat_command, quiet=as_json
                )
                if lacking is not None:
                    typer.echo(
                        f"kept, and not judged; later: {repeat_command} {folder}"
                    )
                    raise typer.Exit(REFUSED)
            check = _checked(folder, model, arm, new_base or "")
            if not add_check(path, check):
                typer.echo(f"{folder}: had been counted before", err=True)
        checks = judged_with(checks_of(path, model.name), check)
        if not checks:
            refuse(f"{path}: has no check of arm {model.name} yet")
        report = _report(checks, model.name, limits, acceptance)
        if out is not None:
            from traverse.lab.daily_check.chart_pictures import (
                write_charts,
            )

            write_charts(report, out)
    from traverse.lab.daily_check.chart_pictures import report_lines
    from traverse.lab.daily_check.report import report_values

    print_report(report_values(report), report_lines(report), as_json=as_json)
    end_by_state(report.outcome.state, strict=strict)


def _lacking() -> str | None:
    from importlib.util import find_spec

    for library in LIBRARIES:
        if find_spec(library) is None:
            return missing("traverse daily-check", library, "lab")
    return None


def _history(config: Path | None, history: Path | None) -> Path:
    from traverse.daemon.state_dir import state_folder

    if (config is None) == (history is None):
        refuse("give --history FILE or --config FILE, one of them")
    try:
        if history is not None:
            history.parent.mkdir(parents=True, exist_ok=True)
            return history
        return state_folder(config or Path()) / HISTORY
    except OSError as error:
        refuse(f"the history's folder cannot be made: {error}")


def _collected(
    path: Path,
    arm: "Arm",
    radius_mm: float,
    broker: BrokerAddress,
    repeat_command: str,
    *,
    quiet: bool,
) -> Path:
    """Guide the collection of a check; return its folder.

    `repeat_command` is the command that computes a folder later.
    """
    from traverse.cli.collect.session import collection_of, run_collection
    from traverse.lab.acceptance.plan import CAMPAIGN
    from traverse.lab.campaign.campaign_file import read_campaign_file
    from traverse.lab.daily_check.figures import write_check

    if not radius_mm > 0.0:
        refuse("--radius missing: the sphere's calibrated radius in mm")
    now = datetime.now(UTC)
    folder = path.parent / "interim" / f"{now:%Y%m%dT%H%M%S.%fZ}"
    write_check(folder, arm, radius_mm, now)
    file = read_campaign_file(folder / CAMPAIGN)
    collection = collection_of(file, folder, arm)
    run_collection(collection, arm.name, broker, ALLOWED, quiet=quiet)
    if unfinished := collection.unfinished():
        end(
            FAILED,
            f"touches are missing: {', '.join(map(str, unfinished))}; "
            "nothing is added to the history. To go on: traverse collect "
            f"{folder / CAMPAIGN} --arm ARM; then: {repeat_command} {folder}",
        )
    return folder


def _checked(folder: Path, arm: "Arm", arm_file: Path, begins: str) -> "Check":
    from traverse.kinematics.arm_file.arm import arm_digest
    from traverse.lab.campaign.campaign_file import read_campaign_file
    from traverse.lab.daily_check.figures import daily_check_figures
    from traverse.lab.daily_check.history import Check
    from traverse.lab.measured_points.measurement import IncompleteError
    from traverse.lab.measured_points.reading import files_read, read_measured
    from traverse.lab.report.provenance import digest_of_files, utc_text

    try:
        figures = daily_check_figures(read_measured(folder, arm, arm_file))
    except IncompleteError as error:
        refuse(f"{folder}: {error}", FAILED)
    start = read_campaign_file(folder / "campaign.toml").start_utc
    return Check(
        utc_text(start or datetime.now(UTC)),
        arm.name,
        arm_digest(arm),
        digest_of_files(files_read(folder)),
        begins,
        figures,
    )


def _report(
    checks: "list[Check]", arm: str, limits: Path | None, acceptance: Path | None
) -> "DailyCheckReport":
    from traverse.lab.acceptance.limits import NO_LIMITS, Limits
    from traverse.lab.daily_check.report import (
        read_certificate,
        report_of,
    )
    from traverse.strict_toml.reader import read_strict

    permitted = NO_LIMITS if limits is None else read_strict(limits, Limits)
    beside: dict[str, Any] | None = None
    if acceptance is not None:
        beside = read_certificate(acceptance, arm)
    return report_of(checks, permitted, beside)
