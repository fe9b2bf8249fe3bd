"""`traverse predict`: how well an arm fits poses that it has not seen."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import (
    check_inputs,
    print_report,
    refusals,
)

SCHEMA = "traverse/prediction/1"


def predict(
    campaign: Path,
    *,
    arm: Path,
    fit_on: Path | None = None,
    fit_tool: bool = False,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    as_json: Json = False,
) -> None:
    """Compute how well an arm fits the poses of a campaign.

    Geometry and effects of the arm are held. Where the artefacts stand, and with
    --fit-tool the probe's vector, is found by the poses of --fit-on, else by those of
    the campaign itself. All poses count.

    Args:
        campaign: Folder with campaign.toml.
        arm: The arm file, which is held.
        fit_on: Campaign with the same artefacts in place.
        fit_tool: Find the probe's vector, too.
        out: CSV file, a line for each pose.
    """
    check_inputs(campaign, arm, fit_on)
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.lab.adjustment import IdentificationError
    from traverse.lab.campaign.campaign import read_campaign
    from traverse.lab.identification import prediction

    with refusals(IdentificationError):
        held = read_arm(arm)
        names = [joint.name for joint in held.joints]
        read = [
            read_campaign(folder, names, several_tools=True, orientations=True)
            for folder in (campaign, *([] if fit_on is None else [fit_on]))
        ]
        for folder, measured in zip((campaign, fit_on), read, strict=False):
            for note in measured.notes:
                typer.echo(f"{folder}: {note}", err=True)
        judged, *fitted = read
        fitted_arm, result = prediction.predicted(
            judged, held, *fitted, with_tool=fit_tool
        )
        if out is not None:
            prediction.write_prediction(result, out)
        curves = prediction.curve_figures(judged, held, *fitted, with_tool=fit_tool)
    tool = None if not fit_tool else list(fitted_arm.probe.vector_mm)
    values = {
        "schema": SCHEMA,
        "arm": str(arm),
        "campaign": str(campaign),
        "fit_on": None if fit_on is None else str(fit_on),
        "probe_vector_mm": tool,
        "distance_mm": result.figures(),
        "artefacts": result.by_artefact(),
        "curves": curves,
    }
    lines = prediction.WORDS.lines("prediction", values, out)
    print_report(values, lines, as_json=as_json)
