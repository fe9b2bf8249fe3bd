"""From files to what was measured: a campaign, a recording, or exported points.

Of a campaign the ball's centres are computed with the arm file, effects included: as
the daemon would. A recording's samples are averaged over each touch. Exported points
are taken as the daemon gave them.
What points share by the arm's parameters is not stated with them: it follows from their
angles and the covariance beside the arm file.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import tomlkit

from traverse.kinematics.arm_file.arm import Arm, parse_arm
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.pose import PoseFlags, corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.lab.artefacts import Artefact
from traverse.lab.campaign.campaign import (
    Campaign,
    read_campaign,
    touching_stretches,
)
from traverse.lab.campaign.campaign_file import (
    CampaignFile,
    Tool,
    example_problems,
    read_campaign_file,
)
from traverse.lab.measured_points.measurement import (
    SCANNED,
    Measurement,
    Occasion,
    measurement_of_touches,
)
from traverse.lab.measured_points.touch_errors import effects_of_poses, errors_of_poses
from traverse.recording.reader import read_recording
from traverse.strict_toml.files import text_of
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    shown,
    unknown_name_message,
)
from traverse.tables.reading import open_table

_PLACE = ("x_mm", "y_mm", "z_mm")
_COLUMNS = ("artefact", "feature", *_PLACE)
# No name of a tool in a campaign has a space.
OWN_PROBE = "own probe"
_NO_VECTOR = (
    "is missing; give it from the probe library or from another campaign: found from "
    "these touches, it would hide its own error"
)


def _holds_places(path: Path) -> bool:
    """Whether a table has coordinates in place of readings."""
    try:
        with open_table(path) as table:
            return _PLACE[0] in table.header
    except FileError:
        return False  # whose reader says what is wrong


def read_points_table(path: Path, file: CampaignFile, arm: Arm) -> Measurement:
    """Read a table of points: artefact, feature, x_mm, y_mm, z_mm, in any order.

    Of further columns temperature_c, probe_radius_mm and time_ns are looked at, no
    others.
    """
    artefacts = {artefact.id: artefact for artefact in file.artefacts}
    names: tuple[list[str], list[str]] = ([], [])
    numbers: list[list[float]] = []
    times_ns: list[int] = []
    with open_table(path) as table:
        for column in _COLUMNS:
            if column not in table.header:
                table.refuse_header(f"column '{column}' is missing; add it")
        table.check()
        for line, row in table.rows_by_name(_PLACE):
            name = row["artefact"]
            if name not in artefacts:
                table.refuse(line, unknown_name_message("artefact", name, artefacts))
                continue
            if not all(row[column] for column in _PLACE):
                cells = [row[column] for column in _PLACE]
                table.refuse(line, f"{shown(cells)} are not three numbers")
                continue
            place_mm = table.vector(line, row, _PLACE)
            warm = table.vector(line, row, ("temperature_c",))
            tip = table.vector(line, row, ("probe_radius_mm",))
            if (time_ns := row.get("time_ns") or "").isdecimal():
                times_ns.append(int(time_ns))
            if place_mm is not None:
                temperature_c = np.nan if warm is None else float(warm[0])
                tip_mm = arm.probe.radius_mm if tip is None else float(tip[0])
                names[0].append(name)
                names[1].append(row["feature"])
                numbers.append([*place_mm.tolist(), temperature_c, tip_mm])
        table.check()
    if not numbers:
        raise FileError(path, "holds no points; measure some")
    occasion = occasion_of(file, times_ns)
    return measurement_of_touches(
        arm, artefacts, names, np.array(numbers), (), occasion=occasion
    )


def read_measured(data: Path, arm: Arm, arm_file: Path | None = None) -> Measurement:
    """Read a campaign's folder, whose poses may be a table of exported points.

    The data are a folder with `campaign.toml` in it, or a recording with a campaign.
    Errors are asked for where the arm's file is given, beside which its covariance is.

    Raises:
        FileError: With everything that is wrong with a file.
    """
    return read_by_tool(data, arm, arm_file, several_tools=False)[0]


def read_by_tool(
    data: Path, arm: Arm, arm_file: Path | None = None, *, several_tools: bool = True
) -> tuple[Measurement, ...]:
    """Read as `read_measured` does, what was touched with each tool by itself.

    Raises:
        FileError: Also where the vector of a tool is not given, or where poses name
            tools and may not.
    """
    if data.suffix == ".mcap":
        return (_from_recording(data, arm, arm_file),)
    file = read_campaign_file(data / "campaign.toml")
    poses = data / file.poses
    # Coordinates in place of readings?
    if poses.suffix != ".mcap" and _holds_places(poses):
        if problems := example_problems(file):
            raise FileError(data / "campaign.toml", problems)
        return (read_points_table(poses, file, arm),)
    names = [joint.name for joint in arm.joints]
    campaign = read_campaign(data, names, several_tools=several_tools)
    numbers = campaign.poses.tools
    if numbers is None:
        measurement = measured_campaign(
            campaign, arm, file.artefacts, str(data), arm_file
        )
        return (measurement,)
    own_tool = Tool(name=OWN_PROBE, vector_mm=arm.probe.vector_mm)
    tools = {number: (own_tool, *file.tools)[number] for number in np.unique(numbers)}
    missing = [tool.name for tool in tools.values() if tool.vector_mm is None]
    if missing:
        problems = [Problem(f"tools.{name}.vector_mm", _NO_VECTOR) for name in missing]
        raise FileError(data / "campaign.toml", problems)
    each = []
    for number, tool in tools.items():
        probe = arm.probe.model_copy(update={"vector_mm": tool.vector_mm})
        with_it = arm.model_copy(update={"probe": probe})
        part = campaign.part(numbers == number)
        measurement = measured_campaign(part, with_it, file.artefacts, str(data))
        unknown = "poses name tools, whose vectors have no stated uncertainty"
        each.append(replace(measurement, tool=tool, errors_unknown=unknown))
    return tuple(each)


def files_read(data: Path) -> tuple[Path, ...]:
    """List the files that `read_measured` reads.

    Raises:
        FileError: They do not lie beside one another.
    """
    if data.suffix == ".mcap":
        return (data,)
    file = read_campaign_file(data / "campaign.toml")
    raw = tomlkit.parse(text_of(data / "campaign.toml"))
    named = [
        data / str(table["points_mm"])
        for table in raw.get("artefacts", ())
        if isinstance(table.get("points_mm"), str)
    ]
    files = (data / "campaign.toml", data / file.poses, *dict.fromkeys(named))
    elsewhere = [path for path in files if path.parent != data]
    if elsewhere:
        raise FileError(
            data / "campaign.toml",
            [Problem("", f"names {p}; put it beside campaign.toml") for p in elsewhere],
        )
    return files


def measured_campaign(
    campaign: Campaign,
    arm: Arm,
    artefacts: Sequence[Artefact],
    source: str = "",
    arm_file: Path | None = None,
) -> Measurement:
    """Compute the ball's centres of a campaign of uncorrected readings.

    The artefacts are those of its file, with the points that were not touched; the
    source is what to call it in errors.

    Raises:
        FileError: The campaign lacks data that effects need.
    """
    geometry = geometry_from_arm(arm)
    of_poses, block = effects_of_poses(arm), campaign.block()
    try:
        effects = effects_of(arm, of_poses, campaign.span)
        places_mm, _, flags = corrected_pose(geometry, effects, block)
    except ValueError as error:
        raise FileError(source, str(error)) from error
    names = [artefact.id for artefact in campaign.artefacts]
    poses = campaign.poses
    touched = [names[index] for index in poses.artefacts.tolist()]
    features = [
        campaign.feature_names[a][f]
        for a, f in zip(poses.artefacts.tolist(), poses.features.tolist(), strict=True)
    ]
    warm = poses.temperature_c
    temperature_c = np.full(len(poses), np.nan) if warm is None else warm
    tip_mm = np.full(len(poses), arm.probe.radius_mm)
    middles = np.arange(len(poses))
    if campaign.is_stream:
        # Samples that follow one another on the same feature are one touch, but of a
        # scan each is a point.
        scanned = np.array([name.startswith(SCANNED) for name in touched])
        changes = np.diff(touching_stretches(campaign)) != 0
        starts = np.flatnonzero(changes | scanned[1:]) + 1
        rows = np.split(np.arange(len(poses)), starts)
        touched = [touched[row[0]] for row in rows]
        features = [features[row[0]] for row in rows]
        places_mm = np.array([places_mm[row].mean(axis=0) for row in rows])
        temperature_c = np.array([temperature_c[row].mean() for row in rows])
        tip_mm = tip_mm[: len(rows)]
        middles = np.array([row[len(row) // 2] for row in rows])
    notes = [*campaign.notes, *_flag_notes(flags)]
    notes += [
        f"{kind} of the arm file is not applied: what a standard is long says its "
        "certificate"
        for kind in dict.fromkeys(
            effect.kind for effect in arm.effects if effect not in of_poses
        )
    ]
    times_ns = list[int]()
    if campaign.start_utc is not None and block.utc_ns is not None:
        times_ns = block.utc_ns.tolist()
    errors: JointCovariance | str = "the arm file is not given"
    if arm_file is not None:
        try:
            errors = errors_of_poses(campaign, middles, places_mm, arm_file, arm)
        except ValueError as error:
            errors = str(error)
    return measurement_of_touches(
        arm,
        {artefact.id: artefact for artefact in artefacts},
        (touched, features),
        np.column_stack([places_mm, temperature_c, tip_mm]),
        notes,
        occasion=occasion_of(campaign, times_ns),
        errors=errors,
    )


def occasion_of(stated: CampaignFile | Campaign, times_ns: Sequence[int]) -> Occasion:
    """Say who measured, where, and from when to when, to the second."""
    ends = [
        datetime.fromtimestamp(ns // 10**9, UTC)
        for ns in ((min(times_ns), max(times_ns)) if times_ns else ())
    ]
    first, last = ends or (None, None)
    digest = stated.digest if isinstance(stated, Campaign) else None
    return Occasion(
        stated.operator,
        stated.place,
        stated.circumstances,
        first,
        last,
        digest or None,
    )


def _flag_notes(flags: PoseFlags) -> Iterator[str]:
    """Return where effects of the arm were applied in part only."""
    for which, words in (
        (
            flags.surface_unknown,
            "effects of the contact left out: no direction_x, y, z",
        ),
        (flags.stale_effect, "a drift is held at its last value: outside its campaign"),
        (flags.empirical, "a curve without a physical name is applied"),
        (flags.beyond_knots, "such a curve is held at its end"),
    ):
        count = int(np.count_nonzero(which))
        if count:
            yield f"{count} of {len(which)} touches: {words}"


def _from_recording(path: Path, arm: Arm, arm_file: Path | None) -> Measurement:
    """Read a recording with its own campaign file; its arm file gives the readings."""
    recording = read_recording(path)
    if recording.campaign_text is None:
        message = (
            "holds no campaign.toml; put one into a folder that names the recording as "
            "its poses, and give the folder"
        )
        raise FileError(path, message)
    parse_arm(recording.arm_text, f"{path}: arm.toml")
    table = tomlkit.parse(recording.campaign_text)
    table["poses"] = str(path.resolve())
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(tomlkit.dumps(table), "utf-8")
        file = read_campaign_file(Path(folder) / "campaign.toml")
        campaign = read_campaign(folder, [joint.name for joint in arm.joints])
    return measured_campaign(campaign, arm, file.artefacts, str(path), arm_file)
