"""`traverse arm`: arm files shown, made of tables and descriptions, and back."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from traverse.cli.arm.options import ArmOptions
from traverse.cli.common.options import CommandGroup, Force, Json
from traverse.cli.common.qif_check import QifSchemas, check_schema, schema_words
from traverse.cli.common.refusals import check_target, print_report, refusals
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.cli.arm.making import MadeArm
    from traverse.kinematics.arm_file.arm import Arm


Out = Annotated[Path, typer.Option("--out", "-o", help="The file to write.")]
IS_ABSOLUTE = (
    "Are the encoders absolute: do they count right again after a loss of power?"
)

arm = CommandGroup(
    "arm", help="Arm files: show one, or make one of a DH table or URDF."
)

Postures = Annotated[
    int, typer.Option(min=1, max=100_000, help="Random ones, to compare at the probe.")
]
Seed = Annotated[int, typer.Option(min=0, help="Of the random postures.")]


@arm.command()
def show(
    file: Path,
    *,
    png: Path | None = None,
    as_json: Json = False,
) -> None:
    """Show an arm: axes, links, reach, encoder steps, effects, identification.

    Args:
        file: An arm file.
        png: Draw the base posture from three sides (extra `lab`).
    """
    from traverse.cli.arm.summary import arm_summary, summary_lines
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.effects.arm_effects import effects_from_arm
    from traverse.kinematics.importers.unit_doubts import arm_doubts
    from traverse.kinematics.uncertainty.arm_covariance import read_parameter_covariance

    with refusals():
        values = read_arm(file)
        if png is not None:
            from traverse.lab.report.arm_picture import draw_base_posture  # extra `lab`

            draw_base_posture(values, png)
    for doubt in arm_doubts(values):
        typer.echo(doubt, err=True)
    try:
        effects = effects_from_arm(values)
        read_parameter_covariance(file, values, effects, effects)
    except ValueError as error:
        typer.echo(error, err=True)
    summary = arm_summary(values)
    print_report(summary, summary_lines(summary), as_json=as_json)


@arm.command("from-dh")
def from_dh(
    table: Path,
    out: Out,
    *,
    convention: Literal["classic", "modified"] | None = None,
    lengths: Literal["mm", "m"] | None = None,
    angles: Literal["rad", "deg"] | None = None,
    options: ArmOptions,
    base_xyz_mm: str | None = None,
    base_rpy_rad: str | None = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make an arm file of a Denavit-Hartenberg table.

    Columns: a_mm, d_mm, alpha_rad and optionally theta_rad (the offset at a reading of
    zero), base_rad, name, counts_per_turn, sign, source; _m and _deg also.

    Args:
        table: The table: CSV, or TOML (.toml).
        convention: Denavit-Hartenberg's or Craig's (modified) rows.
        lengths: Unit of columns named a and d.
        angles: Unit of columns named alpha, theta, base.
        base_xyz_mm: The first frame in the arm's system: x,y,z.
        base_rpy_rad: Its attitude there: roll,pitch,yaw.
    """
    from traverse.cli.arm.making import arm_from_dh_file
    from traverse.kinematics.importers.dh_file import Units

    check_target(out, force=force)
    units = Units(lengths, angles)
    with refusals():
        imported = arm_from_dh_file(
            table,
            units,
            options,
            convention=convention,
            base_xyz_mm=base_xyz_mm,
            base_rpy_rad=base_rpy_rad,
        )
        _write(out, imported, as_json=as_json)


@arm.command("from-urdf")
def from_urdf(
    file: Path,
    out: Out,
    *,
    root: str | None = None,
    tip: str | None = None,
    hold_mm: Annotated[list[str] | None, typer.Option(metavar="JOINT=MM")] = None,
    hold_rad: Annotated[list[str] | None, typer.Option(metavar="JOINT=RAD")] = None,
    options: ArmOptions,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Make an arm file of a robot description (URDF).

    Revolute and continuous joints become joints, fixed ones are merged, masses go
    along. The shank is the tip's z axis unless --tool-rpy-rad turns it.

    Args:
        file: The robot description, plain URDF.
        root: Fixed link; default the root.
        tip: Link with the probe; default the only end.
        hold_mm: A sliding joint that is held at a value, and so fixed.
        hold_rad: A turning joint that is held at a value.
    """
    from traverse.cli.arm.making import arm_from_urdf_file, holds_of

    check_target(out, force=force)
    with refusals():
        holds = holds_of(hold_mm or (), hold_rad or ())
        imported = arm_from_urdf_file(file, root, tip, holds, options)
        _write(out, imported, as_json=as_json)


@arm.command("to-dh")
def to_dh(
    file: Path,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    *,
    parallel_below_rad: Annotated[float, typer.Option(min=1e-12, max=0.1)] = 1e-6,
    postures: Postures = 1000,
    seed: Seed = 1,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find the nearest classic Denavit-Hartenberg table and its misfit at the probe.

    Args:
        file: An arm file.
        out: Write the table: TOML (.toml), else CSV.
        parallel_below_rad: Hinges nearer than this are parallel.
    """
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.importers.dh_report import dh_report, remark_lines
    from traverse.strict_toml.rewriting import rewritten_text
    from traverse.strict_toml.writing import write_atomically

    check_target(out, force=force)
    with refusals():
        report, csv_text = dh_report(read_arm(file), parallel_below_rad, postures, seed)
        if out is not None:
            as_toml = out.suffix.lower() == ".toml"
            write_atomically(
                out, rewritten_text(report["table"]) if as_toml else csv_text
            )
    lines = [f"{out}: classic table", *remark_lines(report)]
    _print_converted(report, csv_text if out is None else None, lines, as_json=as_json)


@arm.command("to-urdf")
def to_urdf(
    file: Path,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    *,
    postures: Postures = 1000,
    seed: Seed = 1,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a robot description (URDF); measure what it leaves out at the probe.

    Args:
        file: An arm file.
        out: Write the description.
    """
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.importers.urdf_report import urdf_remarks, urdf_report
    from traverse.strict_toml.writing import write_atomically

    check_target(out, force=force)
    with refusals():
        values = read_arm(file)
        with refusals(ValueError):
            report, text = urdf_report(values, postures, seed)
        if out is not None:
            write_atomically(out, text)
    lines = [_made(out, values), *urdf_remarks(report)]
    _print_converted(report, text if out is None else None, lines, as_json=as_json)


@arm.command("to-qif")
def to_qif(
    file: Path,
    out: Out,
    *,
    verification: Path | None = None,
    schemas: QifSchemas = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write QIF 3.0 measurement resources: the arm as AACMM, tests where verified.

    Args:
        file: An arm file.
        verification: Folder of `traverse verify --out` of the arm.
    """
    from traverse.cli.arm.qif import qif_of_arm
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.strict_toml.writing import replacing

    check_target(out, force=force)
    with refusals(ValueError):
        content, report = qif_of_arm(read_arm(file), verification)
        if schemas is not None:
            check_schema(content, out, schemas)
        with replacing(out) as target:
            target.write(content)
    report = {"file": str(out), **report, "schema": schema_words(schemas)}
    lines = [
        f"{out}: arm {report['arm']} with {counted(report['joints'], 'joint')}",
        *(f"{test['test']}: {test['of']}" for test in report["tests"]),
        report["schema"],
    ]
    print_report(report, lines, as_json=as_json)


def _print_converted(
    report: object, text: str | None, lines: list[str], *, as_json: bool
) -> None:
    """Print the report as JSON, or the text that is in no file, or lines for people."""
    if text is not None and not as_json:
        typer.echo(text, nl=False)
    else:
        print_report(report, lines, as_json=as_json)


def _write(file: Path, imported: "MadeArm", *, as_json: bool) -> None:
    from traverse.kinematics.arm_file.arm import write_arm

    written = imported.arm
    if _lacks_absolute(written) and sys.stdin.isatty():
        written = _with_absolute(written, typer.confirm(IS_ABSOLUTE, err=True))
    write_arm(file, written)
    for remark in imported.remarks:
        typer.echo(remark, err=True)
    if _lacks_absolute(written):
        typer.echo(
            "whether the encoders count right again after a loss of power is not "
            "known: say --absolute or --incremental, or write absolute = ... in each "
            "[joints.encoder]; until then the daemon asks for a confirmation",
            err=True,
        )
    report = {
        "file": str(file),
        "arm": written.name,
        "joints": [joint.name for joint in written.joints],
        "renamed": imported.renamed,
        "remarks": list(imported.remarks),
    }
    print_report(report, [_made(file, written)], as_json=as_json)


def _lacks_absolute(arm: "Arm") -> bool:
    encoders = [joint.encoder for joint in arm.joints if joint.encoder is not None]
    return any(encoder.absolute is None for encoder in encoders)


def _with_absolute(arm: "Arm", absolute: bool) -> "Arm":
    joints = [
        joint
        if joint.encoder is None or joint.encoder.absolute is not None
        else joint.model_copy(
            update={"encoder": joint.encoder.model_copy(update={"absolute": absolute})}
        )
        for joint in arm.joints
    ]
    return arm.model_copy(update={"joints": type(arm.joints)(joints)})


def _made(file: Path | None, arm: "Arm") -> str:
    return f"{file}: arm {arm.name} with {counted(len(arm.joints), 'joint')}"
