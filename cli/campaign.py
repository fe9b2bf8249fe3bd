"""`traverse campaign`: campaigns of other people's data."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from traverse.cli.common.options import CommandGroup, Force, Json, Yes
from traverse.cli.common.refusals import (
    FAILED,
    check_inputs,
    check_target,
    print_report,
    refusals,
    refuse,
)

campaign = CommandGroup("campaign", help="Make a campaign of other people's data.")

Names = Annotated[str | None, typer.Option(metavar="NAME,...")]


@campaign.command("from-table")
def from_table(
    table: Path,
    *,
    arm: Path,
    out: Path,
    joints: Names = None,
    position: Names = None,
    angles: str | None = None,
    lengths: str | None = None,
    yes: Yes = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make a campaign of rows of joint angles with targets.

    Reads CSV (with or without a header, as RoboDK writes it), MATLAB's .mat, and bags
    of ROS 2 in MCAP (extra `ros`) with JointState and stamped points, poses or
    transforms. Guesses columns and units, shows what it understood, and asks. Exit
    status 1: the answer is no.

    Args:
        table: The table.
        arm: Arm file: the design.
        out: Folder to write.
        joints: Columns of the joints, in the order of the arm.
        position: Columns of x, y, z.
        angles: Unit of the angles: rad or deg.
        lengths: Unit of the targets: mm, m or inch.
    """
    check_inputs(table, arm)
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.model.geometry import geometry_from_arm
    from traverse.lab.campaign import foreign_columns, foreign_table, from_table

    for option, unit, known in (
        ("--angles", angles, foreign_columns.ANGLES),
        ("--lengths", lengths, foreign_columns.LENGTHS),
    ):
        if unit is not None and unit not in known:
            refuse(f"{option} {unit}: expected {' or '.join(known)}")
    for name in from_table.FILES:
        if out.exists():
            check_target(out / name, force=force)
    column_options: Any = {
        "joints": joints and joints.split(","),
        "position": position and position.split(","),
        "angles": angles,
        "lengths": lengths,
    }
    with refusals():
        model = read_arm(arm)
        names = [joint.name for joint in model.joints]
        rows = foreign_table.read_foreign_table(table, len(names))
        with refusals(foreign_columns.UnclearError):
            mapping = foreign_columns.understood(
                rows,
                geometry_from_arm(model),
                names,
                foreign_columns.ColumnOptions(**column_options),
            )
        lines = list(from_table.understood_lines(mapping, names))
        if not yes:
            typer.echo("\n".join([f"{table}: {rows.n_rows} rows", *lines]), err=True)
            if not sys.stdin.isatty():
                refuse("nobody can be asked; give --yes if this is right")
            if not typer.confirm("Is this right?", err=True):
                raise typer.Exit(FAILED)
        sentence = from_table.write_campaign_of(out, table, rows, mapping, names)
    report = {
        "campaign": str(out),
        "rows": rows.n_rows,
        "joints": dict(zip(names, mapping.joints, strict=True)),
        "position": list(mapping.position),
        "orientation": list(mapping.orientation),
        "time": mapping.time,
        "temperature": mapping.temperature,
        "names": mapping.label,
        "left_out": list(mapping.left_out),
        "angles": mapping.angle_unit,
        "lengths": mapping.length_unit,
        "rms_mm": mapping.rms_mm,
    }
    if yes:
        lines.append(sentence)
    else:
        lines = [sentence]
    print_report(report, lines, as_json=as_json)
