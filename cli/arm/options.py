"""Options of the `arm` commands: what they have in common, and lists of numbers."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--out", "-o", help="The arm file to write.")]
Name = Annotated[str | None, typer.Option(help="Name of the arm.")]
Counts = Annotated[
    str | None,
    typer.Option(
        "--counts-per-turn", help="Of the encoders: one number, or one a joint: 1,2,..."
    ),
]
Signs = Annotated[
    str | None,
    typer.Option(help="Sense of the encoders: 1 or -1 for each joint: 1,-1,..."),
]
Device = Annotated[
    str, typer.Option(help="Device of the encoders, channels counted from 0.")
]
PostureRad = Annotated[
    str | None,
    typer.Option(
        "--base-posture-rad", help="Readings in the base posture; default zeros."
    ),
]
PostureDeg = Annotated[
    str | None, typer.Option("--base-posture-deg", help="The same in degrees.")
]
ToolXyz = Annotated[
    str | None,
    typer.Option("--tool-xyz-mm", help="The ball's centre in the last frame: x,y,z."),
]
ToolRpy = Annotated[
    str | None,
    typer.Option(
        "--tool-rpy-rad",
        help="Turns the last frame's z axis into the shank: roll,pitch,yaw.",
    ),
]
Radius = Annotated[
    float,
    typer.Option(
        "--radius-mm", min=0.0, help="Radius of the ball; 0 for a point probe."
    ),
]
Switching = Annotated[
    bool, typer.Option("--switching", help="A switching probe, not a hard one.")
]

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
