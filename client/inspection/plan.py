"""The plan of an inspection: features, relations and tolerances, as in its file."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from traverse.kinematics.features.figures import Expansion, Tolerance
from traverse.kinematics.features.measured import Side
from traverse.kinematics.fits.elements import Kind
from traverse.plurals import counted
from traverse.protocol.messages.fields import Name
from traverse.strict_toml.problems import Problem, unknown_name_message
from traverse.strict_toml.reader import StrictModel

RelationKind = Literal[
    "distance", "angle", "intersection", "projection", "symmetry", "apex"
]
FigureName = Literal["x", "y", "z", "diameter", "angle", "form", "distance"]
Text = Annotated[str, Field(max_length=200)]


class FeatureEntry(StrictModel):
    """A feature that is touched.

    Attributes:
        name: Of the feature; points with this label's feature belong to it.
        kind: Of the element.
        side: From which it is touched; auto: as the points' compensation says.
        plane: Name of the plane that a circle or an edge lies in.
        points: Ids of its points; else those with its label.
        scan: Samples of this scan of a recording belong to it, in place of labels.
        samples: Numbers of the first and the last of them; else all.
    """

    name: Name
    kind: Kind
    side: Side = "auto"
    plane: Name | None = None
    points: tuple[Name, ...] | None = None
    scan: Name | None = None
    samples: Annotated[tuple[int, int], Field(strict=False)] | None = None

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        if self.samples is not None:
            first, last = self.samples
            if self.scan is None or not 0 <= first <= last:
                raise ValueError("samples = [first, last] of a scan, from 0 upwards")
        return self


class RelationEntry(StrictModel):
    """A figure between features, or an element made of them.

    Attributes:
        name: Of the relation; elements that are made can be used by later relations.
        kind: Of the relation.
        of: Names of its features or relations.
    """

    name: Name
    kind: RelationKind
    of: Annotated[tuple[Name, ...], Field(min_length=1, max_length=2)]

    @model_validator(mode="after")
    def _has_its_features(self) -> Self:
        n_features = 1 if self.kind == "apex" else 2
        if len(self.of) != n_features:
            raise ValueError(
                f"{counted(n_features, 'name')} in `of` of the {self.kind}"
            )
        return self


class ToleranceEntry(StrictModel):
    """Limits of a figure: in mm, or of angles in degrees.

    Attributes:
        of: Name of a feature or relation.
        figure: Which of its figures.
        nominal_mm: Nominal value of a length.
        lower_mm: From the nominal value to the lower limit.
        upper_mm: To the upper limit.
        nominal_deg: Nominal value of an angle.
        lower_deg: As lower_mm.
        upper_deg: As upper_mm.
    """

    of: Name
    figure: FigureName
    nominal_mm: float | None = None
    lower_mm: float | None = None
    upper_mm: float | None = None
    nominal_deg: float | None = None
    lower_deg: float | None = None
    upper_deg: float | None = None

    @model_validator(mode="after")
    def _has_limits(self) -> Self:
        lengths = self.nominal_mm, self.lower_mm, self.upper_mm
        angles = self.nominal_deg, self.lower_deg, self.upper_deg
        limits, foreign_limits = (
            (angles, lengths) if self.is_angle else (lengths, angles)
        )
        unit = "deg" if self.is_angle else "mm"
        if None in limits or any(value is not None for value in foreign_limits):
            raise ValueError(
                f"nominal_{unit}, lower_{unit} and upper_{unit} of the figure "
                f"{self.figure}"
            )
        if not (limits[1] or 0.0) < (limits[2] or 0.0):
            raise ValueError("a lower limit below the upper one")
        return self

    @property
    def is_angle(self) -> bool:
        return self.figure == "angle"

    @property
    def tolerance(self) -> Tolerance:
        """The limits, of angles in rad."""
        if self.is_angle:
            limits = self.nominal_deg, self.lower_deg, self.upper_deg
            return Tolerance(*(math.radians(value or 0.0) for value in limits))
        limits = self.nominal_mm, self.lower_mm, self.upper_mm
        return Tolerance(*(value or 0.0 for value in limits))


class PartTemperature(StrictModel):
    """Of the part while it is measured; its lengths are stated at 20 °C.

    Attributes:
        temperature_c: Of the part.
        temperature_std_c: Standard uncertainty of it.
        expansion_per_c: Coefficient of expansion of its material.
        expansion_std_per_c: Standard uncertainty of it.
    """

    temperature_c: float = Field(gt=-50.0, lt=200.0)
    temperature_std_c: float = Field(ge=0.0, le=50.0)
    expansion_per_c: float = Field(gt=-1e-3, lt=1e-3)
    expansion_std_per_c: float = Field(ge=0.0, lt=1e-3)

    @property
    def expansion(self) -> Expansion:
        return Expansion(**self.model_dump())


class Plan(StrictModel):
    """A plan, `features.toml`.

    Attributes:
        part: Its name.
        serial: Serial number of the part.
        operator: Who measured.
        ball_radius_std_mm: Standard uncertainty of the ball's radius.
        part_temperature: Of the part, and its expansion.
        features: Planes before the features in them.
        relations: In their order.
    """

    schema_: Literal["traverse/features/1"] = Field(
        default="traverse/features/1", alias="schema"
    )
    part: Text = ""
    serial: Text = ""
    operator: Text = ""
    ball_radius_std_mm: float | None = Field(default=None, ge=0.0, le=1.0)
    part_temperature: PartTemperature | None = None
    features: tuple[FeatureEntry, ...] = ()
    relations: tuple[RelationEntry, ...] = ()
    tolerances: tuple[ToleranceEntry, ...] = ()


def plan_problems(table: Mapping[str, Any]) -> Iterator[Problem]:
    """Find duplicate and unknown names in a plan as written."""
    entries = [
        (f"{part}.{number}", entry)
        for part in ("features", "relations")
        for number, entry in enumerate(_tables(table, part))
    ]
    names: dict[str, None] = {}
    for place, entry in entries:
        uses = entry.get("of", [entry["plane"]] if "plane" in entry else [])
        for used in uses if isinstance(uses, list) else []:
            if isinstance(used, str) and used not in names:
                message = unknown_name_message("feature before it", used, names)
                yield Problem(place, message)
        name = entry.get("name")
        if isinstance(name, str):
            if name in names:
                yield Problem(f"{place}.name", f"{name!r} is the name of another one")
            names[name] = None
    for number, entry in enumerate(_tables(table, "tolerances")):
        of = entry.get("of")
        if isinstance(of, str) and of not in names:
            message = unknown_name_message("feature", of, names)
            yield Problem(f"tolerances.{number}.of", message)


def _tables(table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    entries = table.get(key, [])
    if not isinstance(entries, list):
        return []
    return [entry for entry in entries if isinstance(entry, Mapping)]
