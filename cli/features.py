"""`traverse features`: figures of a part from touched points, and its report sheet."""

from collections.abc import Mapping
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import (
    FAILED,
    check_inputs,
    print_report,
    refusals,
    refuse,
)
from traverse.installation import missing

if TYPE_CHECKING:
    from traverse.arrays import Floats
    from traverse.client.inspection.values import Inspection
    from traverse.protocol.messages import Point


def features(
    points: Path,
    *,
    plan: Path,
    arm: Path | None = None,
    session: str | None = None,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    logo: Path | None = None,
    as_json: Json = False,
) -> None:
    """Measure planes, circles, distances and so on with their uncertainty.

    A point belongs to the feature that its label names, samples of a scan as the plan
    says. With --out, writes the report sheet features.html, features.json, .csv and
    .qif, and a drawing features.dxf. Exit status 1: a figure does not conform, or is
    not decided; or a feature has no figures.

    Args:
        points: Points: JSON lines, a recording, or an outbox.
        plan: Features, relations and tolerances, TOML.
        arm: Arm file that the points were taken with, its covariance beside it; without
            it there is no uncertainty, and nothing is judged.
        session: Only points of this session.
        out: Folder for the report.
        logo: Picture for the sheet, PNG or JPEG.
    """
    check_inputs(points, plan, arm, logo)
    from traverse.cli.export.file import selected_points
    from traverse.cli.export.scan_samples import with_samples
    from traverse.client.inspection.plan import Plan, plan_problems
    from traverse.client.inspection.results import assigned_points, inspected
    from traverse.client.inspection.sheet import summary_lines
    from traverse.strict_toml.reader import read_strict

    with refusals(ValueError):
        inspection_plan = read_strict(plan, Plan, plan_problems)
        chosen = list(selected_points(points, session, retracted=False))
        inspection_plan, samples = with_samples(inspection_plan, points, session)
        chosen += samples
        assigned = assigned_points(inspection_plan, chosen)
        used = {point.id: point for each in assigned.values() for point in each}
        if not used:
            labels = {p.label.feature for p in chosen if p.label.feature is not None}
            refuse(
                f"{points} has no points of features of {plan}; labels there: "
                f"{', '.join(sorted(labels)) or 'none'}"
            )
        inspection = inspected(
            inspection_plan, chosen, _shared(list(used.values()), arm)
        )
        written = "" if out is None else _write(inspection, out, logo)
    lines = summary_lines(inspection)
    if written:
        lines.append(written)
    print_report(asdict(inspection), lines, as_json=as_json)
    has_problem = any(feature.problem for feature in inspection.features)
    if has_problem or inspection.conformity not in (None, "conforming"):
        raise typer.Exit(FAILED)


def _shared(points: "list[Point]", arm: Path | None) -> "Mapping[str, Floats] | str":
    """Return the points' common errors by the arm, or why they are unknown."""
    if arm is None:
        return "--arm is not given"
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.lab.measured_points.touch_errors import shared_by_points

    read = read_arm(arm)
    try:
        shared_mm = shared_by_points(points, arm, read)
    except ValueError as error:
        return str(error)
    return {point.id: factor for point, factor in zip(points, shared_mm, strict=True)}


def _write(inspection: "Inspection", folder: Path, logo: Path | None) -> str:
    from traverse.client.inspection.drawing import dxf_text
    from traverse.client.inspection.logo import logo_uri
    from traverse.client.inspection.qif import qif_text
    from traverse.client.inspection.sheet import csv_text, json_text, sheet_html
    from traverse.strict_toml.writing import write_atomically

    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "html": sheet_html(inspection, "" if logo is None else logo_uri(logo)),
        "json": json_text(inspection),
        "csv": csv_text(inspection),
        "qif": qif_text(inspection),
    }
    remark = ""
    if find_spec("ezdxf") is None:
        remark = f"; {missing('a drawing', 'ezdxf', 'lab')}"
    else:
        texts["dxf"] = dxf_text(inspection)
    for kind, text in texts.items():
        write_atomically(folder / f"features.{kind}", text)
    return f"wrote {folder}: features.{', .'.join(texts)}{remark}"
