"""`traverse blind`: hide an effect, let diagnosis find it, tell what was hidden."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

if TYPE_CHECKING:
    from traverse.cli.blind_round import Case
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.diagnosis.model.result import Diagnosis

REFUSED = 2
_MOST_EFFECTS = 3


def blind(
    *,
    seed: Annotated[int, typer.Option(help="Of everything that is drawn.", min=0)],
    size: Annotated[
        float,
        typer.Option(
            help="Of each effect: sqrt(lambda), about its standard deviations.",
            min=0.1,
        ),
    ] = 10.0,
    effects: Annotated[
        int, typer.Option(help="How many to hide.", min=0, max=_MOST_EFFECTS)
    ] = 1,
    outside: Annotated[
        bool, typer.Option("--outside", help="Hide what no arm file can name.")
    ] = False,
    arm: Annotated[
        Path | None,
        typer.Option("--arm", help="Arm file; default: that of the demonstration."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the diagnosis and its report."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Report as JSON on standard output.")
    ] = False,
) -> None:
    """Hide an effect in a simulated campaign, let diagnosis find it, and score it.

    What was hidden is told only at the end. Exit status 0, whatever was found.
    """
    given = _arm(arm)
    try:
        from traverse.cli.blind_round import Scenario, find, hide  # noqa: PLC0415
        from traverse.cli.blind_words import round_json, round_lines  # noqa: PLC0415
        from traverse.lab.diagnosis.score import scored  # noqa: PLC0415
    except ImportError as error:
        _refuse(f"{error}; install the extra 'lab': pip install 'traverse-cmm[lab]'")
    from traverse.simulator.campaigns import UnreachableError  # noqa: PLC0415

    scenario = Scenario("blind", effects, size, outside=outside)
    try:
        case = hide(given, scenario, seed)
    except UnreachableError as error:
        _refuse(f"this arm cannot touch what is measured: {error}")
    progress = _told if sys.stderr.isatty() else None
    diagnosis = find(case, progress, details=out is not None)
    score = scored(case.truths, diagnosis)
    if out is not None:
        _write(case, diagnosis, out)
    if as_json:
        typer.echo(json.dumps(round_json(case, diagnosis, score), indent=1))
    else:
        typer.echo("\n".join(round_lines(case, diagnosis, score)))


def _arm(path: Path | None) -> "Arm":
    from traverse.kinematics.arm_file.arm import FileError, read_arm  # noqa: PLC0415

    try:
        return read_arm(path or Path(__file__).parent / "demo_data" / "arm.toml")
    except FileError as error:
        _refuse(str(error))


def _write(case: "Case", diagnosis: "Diagnosis", out: Path) -> None:
    """Write the campaign, the truth beside it, and the diagnosis."""
    from traverse.cli.blind_words import hidden_table  # noqa: PLC0415
    from traverse.lab.diagnosis.report.files import write_diagnosis  # noqa: PLC0415
    from traverse.simulator.campaigns import write_campaign  # noqa: PLC0415
    from traverse.strict_toml.writing import write_atomically  # noqa: PLC0415

    folder = out / "campaign"
    write_campaign(folder, case.simulated, case.arm)
    text = json.dumps({"hidden": hidden_table(case)}, indent=1) + "\n"
    write_atomically(folder / "truth" / "hidden.json", text)
    write_diagnosis(out, diagnosis, folder / "arm.toml")


def _told(what: str, share: float) -> None:
    typer.echo(f"{share:4.0%} {what}", err=True)


def _refuse(message: str) -> NoReturn:
    typer.echo(message, err=True)
    raise typer.Exit(REFUSED)
