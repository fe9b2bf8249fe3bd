"""Where a part's points should be: a table in CSV, or a TOML file with more in it.

The volume that an alignment is for is said by the user, the nominal file, or points. It
is a function of the transformation: the arm's reach is known in the arm's system,
errors are stated in that of the part.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Ball, Box, Volume
from traverse.lab.alignment.touches import read_touch_table
from traverse.lab.measured_points.measurement import reach_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import StrictModel, read_strict

VolumeFunction = Callable[[Helmert], Volume]

REACH = "reach"


def volume_from_text(text: str, arm: Arm | None) -> VolumeFunction:
    """Parse the option for a volume.

    "x,y,z,x,y,z" are two corners of a box in the part's system, "x,y,z,r" is a ball
    there, and "reach" all that the arm can reach, which needs the arm.

    Raises:
        ValueError: It is none of these.
    """
    if text == REACH:
        if arm is None:
            raise ValueError("reach needs the arm file: --arm FILE")
        centre_mm, radius_mm = reach_of(arm)

        def reached(transformation: Helmert) -> Volume:
            middle_mm = transformation.places_mm(centre_mm[np.newaxis])[0]
            return Ball(middle_mm, transformation.scale * radius_mm)

        return reached
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    finite = bool(np.all(np.isfinite(numbers)))
    if finite and len(numbers) == 4 and numbers[3] > 0.0:
        return fixed_volume(Ball(numbers[:3], float(numbers[3])))
    if finite and len(numbers) == 6:
        box = box_around(numbers.reshape(2, 3))
        if np.any(box.high_mm > box.low_mm):
            return fixed_volume(box)
    raise ValueError(
        f"{text!r}; expected six numbers x,y,z,x,y,z for a box, four x,y,z,r for a "
        f"ball, in mm in the part's system, or {REACH}"
    )


def box_around(places_mm: Floats) -> Box:
    """Make the smallest box along the axes that holds places (n, 3)."""
    return Box(places_mm.min(axis=0), places_mm.max(axis=0))


def fixed_volume(volume: Volume) -> VolumeFunction:
    """Take a volume given in the part's system."""
    return lambda _: volume


Vector = tuple[float, float, float]

_PARALLEL = 1e-6


class NominalPoint(StrictModel):
    """A point of the part.

    Attributes:
        name: As in the labels of what is measured.
        std_mm: Standard deviation of each coordinate; 0 where it counts as exact.
    """

    name: Annotated[str, Field(min_length=1)]
    x_mm: float
    y_mm: float
    z_mm: float
    std_mm: float = Field(default=0.0, ge=0.0)


class NominalVolume(StrictModel):
    """Where the alignment will be used: a box, or a ball."""

    min_mm: Vector | None = None
    max_mm: Vector | None = None
    centre_mm: Vector | None = None
    radius_mm: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _is_one_of_both(self) -> Self:
        box, ball = (self.min_mm, self.max_mm), (self.centre_mm, self.radius_mm)
        missing = [sum(value is None for value in pair) for pair in (box, ball)]
        if sorted(missing) != [0, 2]:
            raise ValueError("give min_mm and max_mm, or centre_mm and radius_mm")
        if self.min_mm and self.max_mm:
            sides_mm = np.subtract(self.max_mm, self.min_mm)
            if sides_mm.min() < 0.0 or sides_mm.max() <= 0.0:
                raise ValueError("max_mm is not above min_mm")
        return self

    def volume(self) -> Volume:
        if self.min_mm is not None and self.max_mm is not None:
            return Box(np.array(self.min_mm), np.array(self.max_mm))
        return Ball(np.array(self.centre_mm), float(self.radius_mm or 0.0))


class NominalStop(StrictModel):
    """The point of 3-2-1."""

    feature: str
    point_mm: Vector


class NominalPlane(NominalStop):
    """The plane of 3-2-1: touches lie on it; the normal points out of the part."""

    normal: Vector


class NominalLine(NominalStop):
    """The line of 3-2-1; touches of the feature go from its start to its end."""

    direction: Vector


class Nominal(StrictModel):
    """A part as it should be."""

    schema_: Literal["traverse/nominal/1"] = Field(alias="schema")
    name: str | None = None
    points: tuple[NominalPoint, ...] = ()
    volume: NominalVolume | None = None
    plane: NominalPlane | None = None
    line: NominalLine | None = None
    point: NominalStop | None = None

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        names = [point.name for point in self.points]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"points named twice: {', '.join(twice)}")
        for kind, vector in (
            ("plane.normal", self.plane and self.plane.normal),
            ("line.direction", self.line and self.line.direction),
        ):
            if vector and not np.linalg.norm(vector) > 0.0:
                raise ValueError(f"{kind} has no length")
        if self.plane and self.line:
            across = np.cross(self.plane.normal, self.line.direction)
            vectors = (self.plane.normal, self.line.direction)
            sizes = np.prod(np.linalg.norm(vectors, axis=1))
            if not np.linalg.norm(across) > _PARALLEL * sizes:
                raise ValueError("line.direction is along plane.normal")
        return self

    def places_mm(self) -> Floats:
        """List the points, (n, 3)."""
        places = [(point.x_mm, point.y_mm, point.z_mm) for point in self.points]
        return np.array(places, dtype=np.float64).reshape(-1, 3)


def read_nominal(path: Path) -> Nominal:
    """Read a nominal file, by its ending: .toml, else a table in CSV.

    Raises:
        FileError: With everything that is wrong.
    """
    if path.suffix == ".toml":
        return read_strict(path, Nominal)
    points = []
    for touch in read_touch_table(path, "centre"):
        covariance = touch.covariance_mm2
        x_mm, y_mm, z_mm = touch.place_mm.tolist()
        std_mm = 0.0 if covariance is None else float(np.sqrt(np.trace(covariance) / 3))
        if not touch.names:
            raise FileError(path, "a point has no name; give it one")
        name = touch.names[0]
        point = NominalPoint(name=name, x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, std_mm=std_mm)
        points.append(point)
    try:
        return Nominal(schema="traverse/nominal/1", points=tuple(points))
    except ValidationError as error:
        message = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise FileError(path, message) from error
