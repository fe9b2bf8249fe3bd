"""The strict reading of `campaign.toml` and of the point lists that it names."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AwareDatetime,
    Field,
    PlainValidator,
)

from traverse.kinematics.effect_table import Vector
from traverse.lab.artefacts import (
    Artefact,
    ArtefactTable,
    artefact_from_table,
)
from traverse.lab.artefacts.points import Points
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    shown,
    tables_in,
)
from traverse.strict_toml.reader import StrictModel, read_strict
from traverse.tables.reading import open_table

_POINT_COLUMNS = ["feature", "x_mm", "y_mm", "z_mm"]


class KeysByKind:
    """Stands beside a list of artefacts: where errors look up the keys of a kind."""

    model_fields: ClassVar[Mapping[str, object]] = {}

    variant = staticmethod(ArtefactTable.variant)


class Noise(StrictModel):
    """A-priori standard deviations; what is absent is estimated."""

    encoder_rad: float | None = Field(default=None, gt=0.0)
    contact_mm: float | None = Field(default=None, gt=0.0)
    orientation_rad: float | None = Field(default=None, gt=0.0)


class Tool(StrictModel):
    """Another marker or ball at the end of the arm than the probe of the arm file.

    Attributes:
        name: In the column `tool` of the poses.
        vector_mm: As `probe.vector_mm` of the arm file; without it that of the probe.
        held: Whether that counts, and is not only where the estimate begins.
    """

    name: str = Field(min_length=1)
    vector_mm: Vector | None = None
    held: bool = False


class Circumstances(StrictModel):
    """Circumstances of a measurement that its figures are reported with.

    Attributes:
        probe: Type and serial number of probe and stylus.
        warm_up_min: How long the arm was on before the first touch.
    """

    probe: str | None = Field(default=None, min_length=1)
    humidity_percent: float | None = Field(default=None, ge=0.0, le=100.0)
    pressure_hpa: float | None = Field(default=None, gt=0.0)
    warm_up_min: float | None = Field(default=None, ge=0.0)


NONE_STATED = Circumstances()


# How `traverse verify --plan` marks what is to be replaced.
EXAMPLE = "EXAMPLE"
_TOOL_NAME = re.compile(r"[A-Za-z0-9_-]+")
_CERTIFIED = re.compile(r"(radius|distance|points|form)(_std)?_mm|expansion_per_c")


class CampaignFile(StrictModel):
    """`campaign.toml` as written.

    Attributes:
        start_utc: From where the poses' time_s counts.
        arm_digest: Of the arm file that the angles were read with.
        circumstances: What certificates report beside temperatures.
        noise: A-priori standard deviations.
        tools: What poses may name.
    """

    schema_: Literal["traverse/campaign/1"] = Field(alias="schema")
    poses: str
    time: Literal["seconds", "order"] = "seconds"
    start_utc: AwareDatetime | None = None
    operator: str | None = None
    place: str | None = None
    circumstances: Circumstances = NONE_STATED
    arm_digest: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    gravity_m_s2: Vector | None = None
    noise: Noise = Noise()
    tools: tuple[Tool, ...] = ()
    tables: tuple[
        Annotated[Any, PlainValidator(artefact_from_table), KeysByKind()], ...
    ] = Field(alias="artefacts", min_length=1)

    @property
    def artefacts(self) -> tuple[Artefact, ...]:
        """The tables, each of the class of its kind."""
        return self.tables


def read_campaign_file(path: Path) -> CampaignFile:
    """Read `campaign.toml`; point lists in other files are read in.

    Raises:
        FileError: With everything that is wrong with the first file that is.
    """
    file = read_strict(path, CampaignFile, _problems)
    artefacts = tuple(
        artefact.model_copy(
            update={"points_mm": read_points(path.parent / artefact.points_mm)}
        )
        if isinstance(artefact, Points) and isinstance(artefact.points_mm, str)
        else artefact
        for artefact in file.artefacts
    )
    return file.model_copy(update={"tables": artefacts})


def example_problems(file: CampaignFile) -> list[Problem]:
    """Say what is still as `traverse verify --plan` wrote it; empty where nothing is.

    The values of such a standard are meaningless: they must not count.
    """
    problems = [
        Problem(key, f"is {shown(value)}; say what it is, or leave the line out")
        for key, value in (
            ("operator", file.operator),
            ("place", file.place),
            ("circumstances.probe", file.circumstances.probe),
        )
        if (value or "").startswith(EXAMPLE)
    ]
    marked: dict[str, list[Artefact]] = {}
    for artefact in file.artefacts:
        if (artefact.serial_number or "").startswith(EXAMPLE):
            marked.setdefault(artefact.serial_number or "", []).append(artefact)
    for serial_number, artefacts in marked.items():
        keys = [key for key in artefacts[0].model_fields_set if _CERTIFIED.match(key)]
        ids = [artefact.id for artefact in artefacts]
        more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
        message = (
            f"of {', '.join(ids[:3])}{more} is {shown(serial_number)}: "
            f"{', '.join(sorted(keys))} are an example and do not count; put in the "
            "values of your standard's certificate, and then its serial number"
        )
        problems.append(Problem("artefacts.serial_number", message))
    return problems


def read_points(path: Path) -> dict[str, tuple[float, float, float]]:
    """Read a list of points with the columns feature, x_mm, y_mm, z_mm.

    Raises:
        FileError: With every line that is wrong.
    """
    points: dict[str, tuple[float, float, float]] = {}
    with open_table(path) as table:
        if list(table.header) != _POINT_COLUMNS:
            header, expected = shown(list(table.header)), ",".join(_POINT_COLUMNS)
            table.refuse_header(f"columns are {header}, expected {expected}")
            table.check()
        for line, row in table.rows_by_name(_POINT_COLUMNS[1:]):
            name, *columns = _POINT_COLUMNS
            for column in columns:
                if not row[column]:
                    table.refuse(line, "is empty; give a number", column)
            place_mm = table.vector(line, row, columns)
            if row[name] in points:
                table.refuse(line, f"{shown(row[name])} was given before")
            if place_mm is not None:
                x_mm, y_mm, z_mm = place_mm.tolist()
                points[row[name]] = (x_mm, y_mm, z_mm)
        table.check()
    if not points:
        raise FileError(path, "holds no points; give at least one")
    return points


def _problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    if raw.get("time") == "order" and "start_utc" in raw:
        yield Problem(
            "start_utc",
            'does not go with time = "order": numbers of poses do not count from a '
            "moment; remove one of them",
        )
    tools = [table.get("name") for table in tables_in(raw.get("tools"))]
    for index, tool in enumerate(tools):
        if isinstance(tool, str) and tool in tools[:index]:
            yield Problem(
                f"tools[{index}].name",
                f"{shown(tool)} is also the name of tools[{tools.index(tool)}]; names "
                "must differ",
            )
        if isinstance(tool, str) and not _TOOL_NAME.fullmatch(tool):
            yield Problem(
                f"tools[{index}].name",
                f"{shown(tool)} is not a tool's name; use letters, digits, '-' and '_'",
            )
    first_with_id: dict[str, int] = {}
    for index, table in enumerate(tables_in(raw.get("artefacts"))):
        name = table.get("id")
        if isinstance(name, str) and name in first_with_id:
            yield Problem(
                f"artefacts[{index}].id",
                f"{shown(name)} is also the id of artefacts[{first_with_id[name]}]; "
                "ids must differ",
            )
        if isinstance(name, str):
            first_with_id.setdefault(name, index)
        if table.get("kind") == "points" and table.get("points_mm") == {}:
            yield Problem(f"artefacts[{index}].points_mm", "holds no points; add some")
