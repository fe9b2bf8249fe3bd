"""Sources of the touches of an alignment: points, tables, campaigns."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from traverse.cli.export.sources import points_of
from traverse.client.exports.point_table import standing
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.alignment.touches import (
    Touch,
    names_of,
    read_touch_table,
    touches_of_points,
)
from traverse.lab.measured_points.reading import read_measured
from traverse.strict_toml.problems import FileError, Problem


def read_touches(
    source: Path, coordinates: Literal["centre", "surface"], arm: Arm | None
) -> list[Touch]:
    """Read touches with names, of the ball's centre or of the touched place.

    The source is points in JSON lines, a recording, an outbox, a table in CSV, or the
    folder of a campaign that was measured with an arm.

    Raises:
        FileError: A file was refused.
        ValueError: It is nothing of this, or a point lacks something.
        OSError: It cannot be read.
    """
    if source.is_dir():
        return _of_campaign(source, coordinates, arm)
    if source.suffix == ".csv":
        return read_touch_table(source, coordinates)
    points = standing(list(points_of(source)))
    if not points:
        raise FileError(str(source), [Problem("", "holds no points; measure some")])
    return touches_of_points(points, coordinates)


def _of_campaign(folder: Path, coordinates: str, arm: Arm | None) -> list[Touch]:
    if arm is None:
        raise ValueError(f"{folder}: a campaign needs the arm file: --arm FILE")
    if coordinates != "centre":
        raise ValueError(f"{folder}: a campaign has centres of the ball only")
    measured = read_measured(folder, arm)
    return [
        Touch(names_of(name, feature), place, arm=arm.name, off_mm=float(tip_mm))
        for name, touched in measured.touched.items()
        for feature, place, tip_mm in zip(
            touched.features, touched.places_mm, touched.tip_mm, strict=True
        )
    ]


def arm_of(touches: Sequence[Touch]) -> str | None:
    """The arm that took them; None if unknown.

    Raises:
        ValueError: Several arms did.
    """
    arms = sorted({touch.arm for touch in touches if touch.arm is not None})
    if len(arms) > 1:
        raise ValueError(
            f"points of several arms: {', '.join(arms)}; give those of one"
        )
    return arms[0] if arms else None
