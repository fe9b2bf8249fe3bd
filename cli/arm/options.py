"""Options of the commands that make an arm file."""

from dataclasses import dataclass
from typing import Annotated

import typer


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions:
    """Options of the commands that make an arm file, in the order of `--help`.

    Attributes:
        name: Name of the arm.
        base_posture_rad: Readings in the base posture; default zeros.
        base_posture_deg: The same in degrees.
        counts_per_turn: Of the encoders: one number, or one a joint: 1,2,...
        signs: Sense of the encoders: 1 or -1 for each joint: 1,-1,...
        absolute: Whether the encoders count right again after a loss of power.
        device: Device of the encoders, channels counted from 0.
        tool_xyz_mm: The ball's centre in the last frame: x,y,z.
        tool_rpy_rad: Turns the last frame's z axis into the shank: roll,pitch,yaw.
        radius_mm: Radius of the ball; 0 for a point probe.
        switching: A switching probe, not a hard one.
        rename: Another name for a joint: OLD=NEW; again for others.
    """

    name: str | None = None
    base_posture_rad: str | None = None
    base_posture_deg: str | None = None
    counts_per_turn: str | None = None
    signs: str | None = None
    absolute: Annotated[bool | None, typer.Option("--absolute/--incremental")] = None
    device: str = "base"
    tool_xyz_mm: str | None = None
    tool_rpy_rad: str | None = None
    radius_mm: Annotated[float, typer.Option(min=0.0)] = 0.0
    switching: bool = False
    rename: Annotated[list[str] | None, typer.Option(metavar="OLD=NEW")] = None

    @property
    def probe_kind(self) -> str:
        return "switching" if self.switching else "hard"
