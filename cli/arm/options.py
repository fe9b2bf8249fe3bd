"""Options of the `arm` commands: what they have in common, and lists of numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", "-o", help="The arm file to write.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions:
    """Options of the commands that make an arm file, in the order of `--help`.

    Attributes:
        name: Name of the arm.
        base_posture_rad: Readings in the base posture; default zeros.
        base_posture_deg: The same in degrees.
        counts_per_turn: Of the encoders: one number, or one a joint: 1,2,...
        signs: Sense of the encoders: 1 or -1 for each joint: 1,-1,...
        device: Device of the encoders, channels counted from 0.
        tool_xyz_mm: The ball's centre in the last frame: x,y,z.
        tool_rpy_rad: Turns the last frame's z axis into the shank: roll,pitch,yaw.
        radius_mm: Radius of the ball; 0 for a point probe.
        switching: A switching probe, not a hard one.
    """

    name: str | None = None
    base_posture_rad: str | None = None
    base_posture_deg: str | None = None
    counts_per_turn: str | None = None
    signs: str | None = None
    device: str = "base"
    tool_xyz_mm: str | None = None
    tool_rpy_rad: str | None = None
    radius_mm: Annotated[float, typer.Option(min=0.0)] = 0.0
    switching: bool = False


# In mm or rad: nothing of an arm is larger, and sums stay finite.
_LARGEST = 1e9


def numbers_of(option: str, text: str, count: int) -> tuple[float, ...]:
    """Read numbers with commas between them.

    Raises:
        typer.BadParameter: They are not `count` numbers, finite.
    """
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(abs(n) < _LARGEST for n in numbers):
        expected = f"{count} number{'s' * (count > 1)} below 1e9, commas between"
        raise typer.BadParameter(f"'{text}' is not {expected}", param_hint=option)
    return numbers


def integers_of(option: str, text: str, count: int) -> tuple[int, ...]:
    """Read one integer a joint; a single one holds for all."""
    try:
        numbers = tuple(int(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (1, count):
        expected = f"one integer, or {count} with commas between"
        raise typer.BadParameter(f"'{text}' is not {expected}", param_hint=option)
    return numbers * count if len(numbers) == 1 else numbers


def posture_of(
    rad: str | None, deg: str | None, default_rad: Sequence[float]
) -> tuple[float, ...]:
    """Take the base posture from whichever option is given."""
    if rad is not None and deg is not None:
        raise typer.BadParameter(
            "is given in degrees too; give one of them", param_hint="--base-posture-rad"
        )
    if rad is not None:
        return numbers_of("--base-posture-rad", rad, len(default_rad))
    if deg is not None:
        degrees = numbers_of("--base-posture-deg", deg, len(default_rad))
        return tuple(math.radians(degree) for degree in degrees)
    return tuple(default_rad)
