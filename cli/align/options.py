"""Options of `traverse align`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from traverse.cli.common.options import Operator


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
        """Return why the options are inconsistent; None if they are not."""
        if self.std is not None and not self.std > 0.0:
            return f"--std {self.std:g}: expected a length above zero"
        if self.method == "3-2-1" and (self.scale or self.spheres):
            return "--scale and --spheres do not go with --method 3-2-1"
        if self.onto is not None and self.method != "leapfrog":
            return "--onto needs --method leapfrog"
        return None
