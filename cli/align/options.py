"""Options of `traverse align` that say what is computed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from traverse.cli.options import Operator, with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentOptions:
    """The options, in the order of `--help`; `with_alignment` gives them to `align`."""

    nominal: Annotated[
        Path | None,
        typer.Option(
            help="Where they should be, CSV or TOML; the first station's points with "
            "leapfrog."
        ),
    ] = None
    method: Annotated[
        Literal["best-fit", "3-2-1", "leapfrog"],
        typer.Option(help="Named points; plane, line, point; points of two stations."),
    ] = "best-fit"
    scale: Annotated[bool, typer.Option("--scale", help="Adjust a scale too.")] = False
    std: Annotated[
        float | None,
        typer.Option(help="Standard deviation of a touch [mm]; else the points' own."),
    ] = None
    coordinates: Annotated[
        Literal["centre", "surface"],
        typer.Option(help="Of the ball, or of the surface of compensated points."),
    ] = "centre"
    spheres: Annotated[
        bool, typer.Option("--spheres", help="Names are spheres; their centres count.")
    ] = False
    arm: Annotated[
        Path | None,
        typer.Option(help="Arm file: of a campaign, for shared errors, for its reach."),
    ] = None
    volume: Annotated[
        str | None,
        typer.Option(help="Where it is used: x,y,z,x,y,z or x,y,z,r [mm]; or reach."),
    ] = None
    onto: Annotated[
        Path | None,
        typer.Option(
            help="With leapfrog: the first station's alignment, to be joined."
        ),
    ] = None
    name: Annotated[
        str | None, typer.Option(help="Its name; else the nominal file's.")
    ] = None
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


with_alignment = with_options("options", AlignmentOptions)
