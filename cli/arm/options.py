"""Options of the `arm` commands: what they have in common, and lists of numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", "-o", help="The file to write.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions:
    """Options of the commands that make an arm file, in the order of `--help`."""

    name: Annotated[str | None, typer.Option(help="Name of the arm.")] = None
    base_posture_rad: Annotated[
        str | None, typer.Option(help="Readings in the base posture; default zeros.")
    ] = None
    base_posture_deg: Annotated[
        str | None, typer.Option(help="The same in degrees.")
    ] = None
    counts_per_turn: Annotated[
        str | None,
        typer.Option(help="Of the encoders: one number, or one a joint: 1,2,..."),
    ] = None
    signs: Annotated[
        str | None,
        typer.Option(help="Sense of the encoders: 1 or -1 for each joint: 1,-1,..."),
    ] = None
    device: Annotated[
        str, typer.Option(help="Device of the encoders, channels counted from 0.")
    ] = "base"
    tool_xyz_mm: Annotated[
        str | None, typer.Option(help="The ball's centre in the last frame: x,y,z.")
    ] = None
    tool_rpy_rad: Annotated[
        str | None,
        typer.Option(
            help="Turns the last frame's z axis into the shank: roll,pitch,yaw."
        ),
    ] = None
    radius_mm: Annotated[
        float, typer.Option(min=0.0, help="Radius of the ball; 0 for a point probe.")
    ] = 0.0
    switching: Annotated[
        bool, typer.Option("--switching", help="A switching probe, not a hard one.")
    ] = False


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
