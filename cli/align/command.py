"""`traverse align`: place of the part, its uncertainty, and its use."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import Json, Operator
from traverse.cli.common.refusals import FAILED, print_report, refusals, refuse
from traverse.cli.control import send_command


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentOptions:
    """The options, in the order of `--help`.

    Attributes:
        nominal: Where they should be, CSV or TOML; the first station's points with
            leapfrog.
        method: Named points; plane, line, point; points of two stations.
        scale: Adjust a scale too.
        std: Standard deviation of a touch [mm]; else the points' own.
        coordinates: Of the ball, or of the surface of compensated points.
        spheres: Names are spheres; their centres count.
        arm: Arm file: of a campaign, for shared errors, for its reach.
        volume: Where it is used: x,y,z,x,y,z or x,y,z,r [mm]; or reach.
        onto: With leapfrog: the first station's alignment, to be joined.
        name: Its name; else the nominal file's.
    """

    nominal: Path | None = None
    method: Literal["best-fit", "3-2-1", "leapfrog"] = "best-fit"
    scale: bool = False
    std: float | None = None
    coordinates: Literal["centre", "surface"] = "centre"
    spheres: bool = False
    arm: Path | None = None
    volume: str | None = None
    onto: Path | None = None
    name: str | None = None
    operator: Operator = None

    @property
    def problem(self) -> str | None:
        """Why these do not go together; None where they do."""
        if self.std is not None and not self.std > 0.0:
            return f"--std {self.std:g}: expected a length above zero"
        if self.method == "3-2-1" and (self.scale or self.spheres):
            return "--scale and --spheres do not go with --method 3-2-1"
        if self.onto is not None and self.method != "leapfrog":
            return "--onto needs --method leapfrog"
        return None


def align(
    points: Path | None = None,
    *,
    options: AlignmentOptions,
    strict: bool = False,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    as_json: Json = False,
    send: bool = False,
    clear: bool = False,
    arm_name: str | None = None,
    broker: BrokerOptions,
) -> None:
    """Compute where the part is, and how well that is known.

    Exit status 1: a test failed, nothing is sent then; 2: refused, among others where
    the points do not determine it; 3: daemon or broker could not be reached.

    Args:
        points: Points (JSON lines, CSV, recording, outbox), a campaign's folder; or an
            alignment.json to send.
        strict: Exit status 1 where anything is flagged.
        out: Folder for alignment.json and .html.
        send: Have the daemon use it, if no test failed.
        clear: Have the daemon use none from now on.
        arm_name: To which arm to send; else that of the points.
    """
    if clear:
        send_command(arm_name, broker, lambda arm: arm.clear_alignment())
        typer.echo("points have no part coordinates")
        return
    if points is None:
        refuse("name the points to be aligned, or give --clear")
    from traverse.lab.alignment import files

    with refusals():
        if options.problem is not None:
            refuse(options.problem)
        if options.nominal is not None:
            from traverse.cli.align.computing import compute_alignment

            with refusals(ValueError):
                values = compute_alignment(points, options.nominal, options)
        elif send:  # one that was computed before
            values = files.read_alignment(points)
        else:
            refuse("--nominal missing; or give an alignment.json and --send")
        if out is not None:
            files.write_alignment(values, out)
    wrote = f"wrote {out}: alignment.json, alignment.html"
    lines = [*files.WORDS.lines("summary", values), *([] if out is None else [wrote])]
    print_report(values, lines, as_json=as_json)
    if not values["passed"] or (strict and values["flags"]):
        raise typer.Exit(FAILED)
    if send:
        to = arm_name or values["arm"]
        if to is None:
            refuse("the points do not name their arm; give --arm-name")
        send_command(to, broker, lambda arm: arm.execute(files.align_args(values)))
        typer.echo(f"{to} uses it from now on", err=True)
