"""`traverse diagnose`: what the model of an arm lacks, from a campaign."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.options import HoldoutBy, Json, Operator, campaign_folder
from traverse.cli.refusals import (
    FAILED,
    check_results,
    end,
    print_report,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.campaign.campaign import Campaign
    from traverse.lab.diagnosis.model.result import Diagnosis, DiagnosisOptions
    from traverse.lab.diagnosis.scans.scan_diagnosis import StreamDiagnosis
    from traverse.lab.report.provenance import ReportProvenance


def diagnose(
    campaign: Annotated[
        Path,
        typer.Argument(help="Folder with campaign.toml.", callback=campaign_folder),
    ],
    *,
    arm: Annotated[
        Path, typer.Option("--arm", help="Arm file: the design, or an identified arm.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the results; not with --plan."),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(min=0, help="Seed of the held-out split and of the thresholds."),
    ] = 1,
    holdout_by: HoldoutBy = "time",
    accept: Annotated[
        bool, typer.Option("--accept", help="Write the adapted arm to ARM itself.")
    ] = False,
    accept_tentative: Annotated[
        bool,
        typer.Option(
            "--accept-tentative", help="Tentative terms enter the adapted arm too."
        ),
    ] = False,
    max_terms: Annotated[
        int, typer.Option(min=1, max=10, help="Terms to add at most.")
    ] = 4,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit status 1 if anything is missing.")
    ] = False,
    operator: Operator = None,
    as_json: Json = False,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help="Only print which effects this campaign could detect, and from which "
            "size on.",
        ),
    ] = False,
) -> None:
    """Find what the model of an arm lacks, and add it.

    Writes arm.toml with the effects that were found, diagnosis.json,
    discrepancies.csv, report.html and its pictures. Exit status 1: --strict and
    something is missing, or the adjustment broke down.
    """
    with refusals():
        if plan:
            if accept or accept_tentative or out is not None:
                refuse("--plan writes nothing; leave out --out and --accept")
            _plan(campaign, arm, as_json=as_json)
            return
        if out is None:
            refuse("--out missing: name a folder for the results, or give --plan")
        if not accept:
            check_results(out, arm)
        from traverse.lab.diagnosis.model.result import DiagnosisOptions  # noqa: PLC0415

        options = DiagnosisOptions(
            seed=seed,
            holdout_by=holdout_by,
            most_terms=max_terms,
            accept_tentative=accept_tentative,
        )
        result, stream = _diagnosed(campaign, arm, options)
        from traverse.lab.report.provenance import campaign_provenance  # noqa: PLC0415

        provenance = campaign_provenance(result.campaign, operator)
        lines = _written(result, arm, out, provenance, accept=accept)
        if stream is not None:
            lines = _with_stream(stream, lines, out)
    from traverse.lab.diagnosis.report.files import diagnosis_json  # noqa: PLC0415

    print_report(diagnosis_json(result, provenance), lines, as_json=as_json)
    if strict and result.verdict != "clean":
        raise typer.Exit(FAILED)


def _diagnosed(
    folder: Path, arm_file: Path, options: "DiagnosisOptions"
) -> "tuple[Diagnosis, StreamDiagnosis | None]":
    import numpy as np  # noqa: PLC0415

    from traverse.lab.diagnosis.diagnose import diagnose as found_by  # noqa: PLC0415
    from traverse.lab.diagnosis.scans.scan_diagnosis import diagnose_stream  # noqa: PLC0415
    from traverse.lab.identification.identify import IdentificationError  # noqa: PLC0415

    arm, campaign = _read(folder, arm_file)
    progress = _Progress() if sys.stderr.isatty() else None
    for note in campaign.notes:
        typer.echo(f"{folder}: {note}", err=True)
    try:
        if campaign.is_stream:
            stream = diagnose_stream(campaign, arm, options, progress)
            return stream.diagnosis, stream
        return found_by(campaign, arm, options, progress), None
    except IdentificationError as error:
        refuse(str(error))
    except np.linalg.LinAlgError as error:
        end(
            FAILED,
            f"{folder}: the adjustment broke down ({error}); check units, signs and "
            "zeros of the arm file, and the features of the poses; see "
            "`traverse identify`",
        )
    finally:
        if progress is not None:
            progress.close()


def _written(
    result: "Diagnosis",
    arm_file: Path,
    out: Path,
    provenance: "ReportProvenance",
    *,
    accept: bool,
) -> list[str]:
    from traverse.lab.diagnosis.report.files import (  # noqa: PLC0415
        write_adapted,
        write_diagnosis,
    )
    from traverse.lab.diagnosis.report.page import summary_lines  # noqa: PLC0415

    adapted = write_diagnosis(out, result, arm_file, provenance=provenance)
    names = "arm.toml, diagnosis.json, discrepancies.csv, report.html, pictures"
    lines = [*summary_lines(result), f"wrote {out}: {names}"]
    if accept:
        write_adapted(arm_file, adapted, arm_file)
        lines.append(f"wrote {arm_file}: the adapted arm in place of the old one")
    return lines


def _with_stream(stream: "StreamDiagnosis", lines: list[str], out: Path) -> list[str]:
    """Write the results of a dense scan, and print them first."""
    from traverse.lab.diagnosis.scans.scan_diagnosis import stream_json, stream_lines  # noqa: PLC0415

    text = json.dumps(stream_json(stream), indent=1, allow_nan=False)
    (out / "stream.json").write_text(text + "\n", encoding="utf-8")
    return [*stream_lines(stream), *lines, f"wrote {out / 'stream.json'}"]


class _Progress:
    """Print each stage in one line that is overwritten."""

    def __init__(self) -> None:
        self._width = 0

    def __call__(self, stage: str, part: float) -> None:
        text = f"{100.0 * part:3.0f} % {stage}"
        typer.echo(f"\r{text:<{self._width}}", nl=False, err=True)
        self._width = max(self._width, len(text))

    def close(self) -> None:
        """Wipe the line."""
        if self._width:
            typer.echo(f"\r{'':<{self._width}}\r", nl=False, err=True)


def _plan(folder: Path, arm_file: Path, *, as_json: bool) -> None:
    """Print what a campaign could detect, without its measured misclosures."""
    from traverse.lab.diagnosis.advice.minimal_detectable import planned  # noqa: PLC0415
    from traverse.lab.diagnosis.report.files import detectable_json  # noqa: PLC0415
    from traverse.lab.diagnosis.report.names import (  # noqa: PLC0415
        detectable_lines,
    )
    from traverse.lab.diagnosis.scans.decimation import decimated  # noqa: PLC0415
    from traverse.lab.identification.identify import IdentificationError  # noqa: PLC0415

    arm, campaign = _read(folder, arm_file)
    with refusals(IdentificationError):
        if campaign.is_stream:
            campaign, thinning = decimated(campaign, arm)
            campaign = campaign.part(thinning.poses)
        found = planned(campaign, arm)
    head = (
        f"{arm.name}: what {counted(len(campaign.poses), 'pose')} could show, with a "
        "probability of 95 %, in the worst phase or direction"
    )
    lines = [head, *detectable_lines(found)]
    print_report({"detectable": detectable_json(found)}, lines, as_json=as_json)


def _read(folder: Path, arm_file: Path) -> "tuple[Arm, Campaign]":
    from traverse.kinematics.arm_file.arm import read_arm  # noqa: PLC0415
    from traverse.lab.campaign.campaign import read_campaign  # noqa: PLC0415

    arm = read_arm(arm_file)
    names = [joint.name for joint in arm.joints]
    return arm, read_campaign(folder, names, several_tools=True)
