"""`traverse identify`: an arm from a campaign, and two results compared."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.campaign_inputs import (
    Family,
    PriorPatterns,
    adjustment_errors,
    read_noted,
)
from traverse.cli.common.options import HoldoutBy, Json, Operator, campaign_folder
from traverse.cli.common.refusals import (
    check_inputs,
    check_results,
    end_by_state,
    print_report,
    refusals,
    refuse,
)
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.lab.campaign.campaign import Campaign
    from traverse.lab.identification.identify import Options
    from traverse.lab.outcomes.adjustment import Iteration


def identify(
    campaign: Annotated[Path | None, typer.Argument(callback=campaign_folder)] = None,
    *,
    arm: Path | None = None,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    hold: list[str] | None = None,
    free: list[str] | None = None,
    masks: Path | None = None,
    holdout: Annotated[float | None, typer.Option(min=0.01, max=0.9)] = None,
    holdout_by: HoldoutBy = "time",
    seed: Annotated[int, typer.Option(min=0)] = 0,
    strict: bool = False,
    write_unfit_arm: bool = False,
    family: Family = None,
    prior: PriorPatterns = None,
    as_json: Json = False,
    operator: Operator = None,
    compare: Annotated[tuple[Path, Path] | None, typer.Option(metavar="A B")] = None,
) -> None:
    """Find an arm's geometry from a campaign, by least squares.

    Writes arm.toml, its covariance, identification.json, residuals.csv and report.html.
    Where an arm file of the result must not be measured with, only identification.json
    and report.html: no convergence, no redundancy, no scale, or misclosures that no arm
    of this design leaves. Exit status 1: the result is bad; 4: --strict, and it is in
    doubt.

    Args:
        campaign: Folder with campaign.toml.
        arm: Arm file: the design, or an earlier result.
        out: Folder for the results.
        hold: Hold parameters, e.g. 'J7.*'. Repeatable; before --free.
        free: Free parameters, e.g. 'probe.vector.*'. Repeatable.
        masks: File with patterns to hold and to free, TOML.
        holdout: Part of the poses to keep aside and predict, e.g. 0.3.
        seed: Of the choice of --holdout.
        strict: Exit status 4 if the result is in doubt.
        write_unfit_arm: Write arm.toml even where it must not be measured with.
        compare: Compare two arm files or folders of results at the probe instead.
    """
    check_inputs(campaign, arm, masks, family, *(compare or ()))
    with refusals():
        if compare is not None:
            _compare(*compare, campaign, as_json=as_json)
            return
        missing = [
            name
            for name, value in (("CAMPAIGN", campaign), ("--arm", arm), ("--out", out))
            if value is None
        ]
        if campaign is None or arm is None or out is None:
            refuse(f"{', '.join(missing)} missing; or give --compare A B")
        check_results(out, arm)
        from traverse.lab.runs import identification as runs

        options = _options(hold or [], free or [], masks)
        design, measured = read_noted(campaign, arm, family, prior)
        with adjustment_errors():
            if holdout is not None:
                from traverse.lab.runs.kept_aside import (
                    KeptAside,
                    identified_and_predicted,
                )

                kept = KeptAside(holdout, holdout_by, seed)
                progress = _Progress if sys.stderr.isatty() else None
                result = identified_and_predicted(
                    measured, design, options, kept, progress
                )
            else:
                show = _Progress(measured) if sys.stderr.isatty() else None
                result = runs.identified(measured, design, options, show)
        provenance = result.campaign.provenance(operator)
        lines = runs.write_identified(
            result, out, provenance, unfit_arm=write_unfit_arm
        )
    from traverse.lab.identification.results import files as files_of

    values = files_of.identification_json(result, provenance)
    print_report(values, lines, as_json=as_json)
    end_by_state(values["state"], strict=strict)


def _options(hold: list[str], free: list[str], masks: Path | None) -> "Options":
    """The masks of the command line, and of a file."""
    from traverse.lab.identification.identify import Masks, Options
    from traverse.strict_toml.reader import read_strict

    if masks is not None:
        masks_in_file = read_strict(masks, Masks)
        hold, free = [*hold, *masks_in_file.hold], [*free, *masks_in_file.free]
    return Options(hold=tuple(hold), free=tuple(free))


class _Progress:
    """Print a line for every iteration."""

    def __init__(self, campaign: "Campaign") -> None:
        rows = [artefact.rows_per_pose for artefact in campaign.artefacts]
        self._n_rows = sum(
            rows[artefact_row] for artefact_row in campaign.poses.artefacts.tolist()
        )
        self._n_rows += 3 * int(campaign.poses.oriented.sum())
        self._n_told = 0

    def __call__(self, iteration: "Iteration") -> None:
        self._n_told += 1
        misfit = (iteration.sum_of_squares / self._n_rows) ** 0.5
        shortened = "" if iteration.fraction == 1.0 else f" x {iteration.fraction:.3g}"
        typer.echo(
            f"iteration {self._n_told:3d}: misfit {misfit:.4g} sigma, "
            f"{iteration.rms_mm:.4g} mm rms, "
            f"step {iteration.step:.3g} sigma{shortened}, "
            f"{counted(iteration.n_determined, 'direction')} determined",
            err=True,
        )


def _compare(first: Path, second: Path, folder: Path | None, *, as_json: bool) -> None:
    """Compare two arms at the probe, within a campaign's ranges if there is one."""
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.lab.identification.results import arm_comparison
    from traverse.lab.runs.inputs import read_inputs

    files = [path / "arm.toml" if path.is_dir() else path for path in (first, second)]
    arms = [read_arm(file) for file in files]
    ranges = None
    if folder is not None:
        angles_rad = read_inputs(folder, files[0])[1].poses.angles_rad
        ranges = (angles_rad.min(axis=0), angles_rad.max(axis=0))
    with refusals(arm_comparison.ComparisonError):
        comparison = arm_comparison.compare_arms(arms[0], arms[1], ranges)
    values = arm_comparison.comparison_values(files, arms, comparison)
    from traverse.lab.identification.report.page import WORDS

    print_report(values, WORDS.lines("comparison", values), as_json=as_json)
