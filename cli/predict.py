"""`traverse predict`: how well an arm fits poses that it has not seen."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from traverse.cli.options import Json
from traverse.cli.refusals import print_report, refusals

if TYPE_CHECKING:
    from traverse.lab.campaign.campaign import Campaign
    from traverse.lab.identification.prediction import Prediction

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
    from traverse.kinematics.arm_file.arm import read_arm  # noqa: PLC0415
    from traverse.lab.campaign.campaign import read_campaign  # noqa: PLC0415
    from traverse.lab.identification import prediction  # noqa: PLC0415
    from traverse.lab.identification.identify import IdentificationError  # noqa: PLC0415

    with refusals(IdentificationError):
        held = read_arm(arm)
        names = [joint.name for joint in held.joints]
        judged = fitted = read_campaign(
            campaign, names, several_tools=True, orientations=True
        )
        if fit_on is not None:
            fitted = read_campaign(fit_on, names, several_tools=True, orientations=True)
        for folder, one in {campaign: judged, fit_on or campaign: fitted}.items():
            for note in one.notes:
                typer.echo(f"{folder}: {note}", err=True)
        found = prediction.placed(fitted, held, with_tool=fit_tool)
        places = {} if fit_on is None else prediction.places_of(found)
        known = {} if fit_on is None else prediction.mountings_of(found)
        result = prediction.predict(judged, found.arm, places, found.tools_mm, known)
        if out is not None:
            _write_poses(result, out)
    tool = None if not fit_tool else list(found.arm.probe.vector_mm)
    values = {
        "schema": SCHEMA,
        "arm": str(arm),
        "campaign": str(campaign),
        "fit_on": None if fit_on is None else str(fit_on),
        "probe_vector_mm": tool,
        "distance_mm": result.figures(),
        "artefacts": result.by_artefact(),
    }
    print_report(values, _lines(values, out), as_json=as_json)


def _lines(values: dict[str, Any], out: Path | None) -> list[str]:
    from traverse.lab.report.quantities import length_mm  # noqa: PLC0415

    fitted_by = values["fit_on"] or "the same poses"
    own = [i for i, row in values["artefacts"].items() if row["placed_by"] == "itself"]
    others = [name for name in values["artefacts"] if name not in own]
    lines = [
        f"{values['campaign']}: {values['distance_mm']['n']} poses, {values['arm']}"
    ]
    if others:
        lines.append(f"artefacts placed by {fitted_by}: {', '.join(others)}")
    if own:
        text = f"artefacts placed by the same poses: {', '.join(own)}"
        lines.append(f"{text}; distances are somewhat too small")
    vector_mm = values["probe_vector_mm"]
    lines.append(
        "tool: of the arm file"
        if vector_mm is None
        else f"tool: fitted to {fitted_by}, vector_mm = "
        f"[{', '.join(f'{x:.4f}' for x in vector_mm)}]"
    )
    rows = {"all poses": values["distance_mm"]}
    rows |= values["artefacts"] if len(values["artefacts"]) > 1 else {}
    lines += [
        f"{name}: distance {length_mm(row['mean_mm'])} in the mean, "
        f"{length_mm(row['rms_mm'])} rms, {length_mm(row['median_mm'])} median, "
        f"95 % below {length_mm(row['p95_mm'])}, "
        f"largest {length_mm(row['largest_mm'])} (line {row['largest_line']})"
        for name, row in rows.items()
    ]
    lines += [
        f"{name}: orientation off by {row['mean_rad']:.3g} rad in the mean, "
        f"{row['rms_rad']:.3g} rad ({row['rms_deg']:.3g} degrees) rms, "
        f"largest {row['largest_rad']:.3g} rad ({row['largest_deg']:.3g} degrees, "
        f"line {row['largest_line']}), {row['n']} poses"
        for name, row in ((n, r.get("orientation")) for n, r in rows.items())
        if row is not None
    ]
    return [*lines, f"wrote {out}"] if out is not None else lines


def _write_poses(result: "Prediction", path: Path) -> None:
    """Write a line for each pose: distance, and the misclosures that make it up.

    With orientations also by how much they are off about each axis.
    """
    campaign: Campaign = result.campaign
    poses = campaign.poses
    header = ["line", "artefact", "feature", "distance_mm", "w1_mm", "w2_mm", "w3_mm"]
    rows = result.misclosures_mm.tolist()
    if any(poses.oriented):
        header += [f"orientation_{axis}_rad" for axis in "xyz"]
        errors_rad = result.orientation_errors_rad.tolist()
        rows = [[*mm, *rad] for mm, rad in zip(rows, errors_rad, strict=True)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for at, row in enumerate(rows):
            writer.writerow(
                [
                    int(poses.lines[at]),
                    *campaign.touched_cells(at),
                    f"{result.distances_mm[at]:.6g}",
                    *("" if w != w else f"{w:.6g}" for w in row),  # noqa: PLR0124 NaN
                ]
            )
