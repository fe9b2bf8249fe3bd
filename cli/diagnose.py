"""`traverse diagnose`: effects missing in the model of an arm, from a campaign."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.campaign_inputs import (
    CampaignFolder,
    Family,
    PriorPatterns,
    adjustment_errors,
    read_noted,
)
from traverse.cli.common.options import HoldoutBy, Json, Operator
from traverse.cli.common.refusals import (
    FAILED,
    check_inputs,
    check_results,
    end_by_state,
    print_report,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.campaign.campaign import Campaign


def diagnose(
    campaign: CampaignFolder,
    *,
    arm: Path,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    holdout_by: HoldoutBy = "time",
    accept: bool = False,
    accept_tentative: bool = False,
    max_terms: Annotated[int, typer.Option(min=1, max=10)] = 4,
    strict: bool = False,
    family: Family = None,
    prior: PriorPatterns = None,
    operator: Operator = None,
    as_json: Json = False,
    plan: bool = False,
) -> None:
    """Find what the model of an arm lacks, and add it.

    Writes arm.toml with the effects that were found, its covariance, diagnosis.json,
    discrepancies.csv, report.html and its pictures. No arm.toml where the arm must not
    be measured with: no convergence, no scale, or an arm file that does not fit. Exit
    status 1: the state of the result is bad, or --strict and something is missing, or
    the adjustment broke down; 4: --strict and the result is in doubt.

    Args:
        arm: Arm file: the design, or an identified arm.
        out: Folder for the results; not with --plan.
        seed: Seed of the held-out split and of the thresholds.
        accept: Write the adapted arm to ARM itself, too.
        accept_tentative: Tentative terms enter the adapted arm too.
        max_terms: Terms to add at most.
        strict: Exit status 1 if anything is missing, 4 if the result is in doubt.
        plan: Only print which effects this campaign could detect, and from which size
            on.
    """
    check_inputs(campaign, arm)
    with refusals():
        if plan:
            if accept or accept_tentative or out is not None:
                refuse("--plan writes nothing; leave out --out and --accept")
            _plan(*read_noted(campaign, arm, family, prior), as_json=as_json)
            return
        if out is None:
            refuse("--out missing: name a folder for the results, or give --plan")
        if not accept:
            check_results(out, arm)
        from traverse.lab.diagnosis.model.result import DiagnosisOptions

        options = DiagnosisOptions(
            seed=seed,
            holdout_by=holdout_by,
            most_terms=max_terms,
            accept_tentative=accept_tentative,
        )
        from traverse.lab.runs import diagnosis as runs

        design, measured = read_noted(campaign, arm, family, prior)
        progress = _Progress() if sys.stderr.isatty() else None
        try:
            with adjustment_errors():
                diagnosis = runs.diagnosed(measured, design, options, progress)
        finally:
            if progress is not None:
                progress.close()
        result = diagnosis[0]
        provenance = result.campaign.provenance(operator)
        lines = runs.write_diagnosed(diagnosis, arm, out, provenance, accept=accept)
    from traverse.lab.diagnosis.report.outcome import diagnosis_json, outcome_of

    print_report(diagnosis_json(result, provenance), lines, as_json=as_json)
    end_by_state(outcome_of(result).state.value, strict=strict)
    if strict and result.verdict != "clean":
        raise typer.Exit(FAILED)


class _Progress:
    """Print each stage in one line that is overwritten."""

    def __init__(self) -> None:
        self._width = 0

    def __call__(self, stage: str, part: float) -> None:
        text = f"{100.0 * part:3.0f} % {stage}"
        typer.echo(f"\r{text:<{self._width}}", nl=False, err=True)
        self._width = max(self._width, len(text))

    def close(self) -> None:
        if self._width:
            typer.echo(f"\r{'':<{self._width}}\r", nl=False, err=True)


def _plan(arm: "Arm", campaign: "Campaign", *, as_json: bool) -> None:
    """Print the effects that a campaign could detect, without its misclosures."""
    from traverse.lab.diagnosis.advice.minimal_detectable import planned
    from traverse.lab.diagnosis.report.names import detectable_lines
    from traverse.lab.diagnosis.scans.decimation import decimated
    from traverse.lab.report.quantities import plain_values

    with adjustment_errors():
        if campaign.is_stream:
            campaign, thinning = decimated(campaign, arm)
            campaign = campaign.part(thinning.poses)
        plan = planned(campaign, arm)
    head = (
        f"{arm.name}: what {counted(len(campaign.poses), 'pose')} could show, with a "
        "probability of 95 %, in the worst phase or direction"
    )
    lines = [head, *detectable_lines(plan)]
    print_report({"detectable": plain_values(plan)}, lines, as_json=as_json)
