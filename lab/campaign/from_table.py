"""A campaign's files from a table that was understood."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.campaign.foreign_columns import TIMES, Understood, unit_of_column
from traverse.lab.campaign.foreign_table import ForeignTable
from traverse.plurals import counted
from traverse.strict_toml.writing import write_atomically

ARTEFACT = "targets"
FILES = ("campaign.toml", "poses.csv", "points.csv")
# A design whose ball is further from the targets than this part of their spread is
# another arm, or has other signs, zeros or an order of its own.
_POOR_FIT = 0.2

_CAMPAIGN = """\
# Made of {source} by `traverse campaign from-table`.
schema = "traverse/campaign/1"
poses = "poses.csv"
{time}
# Standard deviations of a reading and of a target's coordinates; estimated without.
# [noise]
# encoder_rad = 1e-5
# contact_mm = 0.05

[[artefacts]]
id = "{artefact}"
kind = "points"
frame = "own"           # that of the targets: its six parameters are estimated
points_mm = "points.csv"
"""


def understood_lines(meant: Understood, joint_names: Sequence[str]) -> Iterator[str]:
    pairs = zip(joint_names, meant.joints, strict=True)
    joints = ", ".join(f"{joint}: {column}" for joint, column in pairs)
    yield f"joints      {joints} [{meant.angle_unit}]"
    yield f"targets     {', '.join(meant.position)} [{meant.length_unit}]"
    if meant.orientation:
        yield f"orientation {', '.join(meant.orientation)} (w, x, y, z)"
    yield f"time        {meant.time or 'none: the order of the rows'}"
    if meant.temperature:
        yield f"temperature {meant.temperature} [C]"
    if meant.label:
        yield f"names       {meant.label}"
    if meant.left_out:
        yield f"left out    {', '.join(meant.left_out)}"
    yield from meant.reasons
    off_mm = meant.places_mm - meant.places_mm.mean(axis=0)
    spread_mm = float(np.linalg.norm(off_mm) / np.sqrt(len(off_mm)))
    yield (
        f"after the best rigid motion the arm's ball is {meant.rms_mm:.3g} mm rms "
        f"from the targets, which are spread by {spread_mm:.4g} mm"
    )
    if meant.rms_mm > _POOR_FIT * spread_mm:
        yield (
            "that is far: mind the units, signs and zeros of the readings, the order "
            "of the joints, and the marker's offset"
        )


def write_campaign_of(
    folder: Path,
    source: Path,
    table: ForeignTable,
    meant: Understood,
    joint_names: Sequence[str],
) -> str:
    """Write campaign.toml, poses.csv and points.csv; read them back.

    Returns:
        What was written, in a sentence.

    Raises:
        FileError: What was written is no campaign.
        OSError: It cannot be written.
    """
    times_s = _times_s(table, meant)
    features, points = _points(table, meant)
    columns = [
        "time_s",
        "artefact",
        "feature",
        *(f"{name}_rad" for name in joint_names),
    ]
    extra = []
    if meant.temperature is not None:
        columns.append("temperature_c")
        extra.append(table.numbers[meant.temperature])
    if meant.orientation:
        columns += [f"orientation_{axis}" for axis in "wxyz"]
        quaternions = np.column_stack([table.numbers[n] for n in meant.orientation])
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        extra += list(quaternions.T)
    rows = [
        [index if times_s is None else times_s[index], ARTEFACT, features[index]]
        + [float(number) for number in meant.angles_rad[index]]
        + ["" if np.isnan(column[index]) else float(column[index]) for column in extra]
        for index in range(table.n_rows)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    time = 'time = "order"' if times_s is None else ""
    text = _CAMPAIGN.format(source=source.name, time=time, artefact=ARTEFACT)
    write_atomically(folder / "points.csv", _csv(["feature", *_XYZ], points))
    write_atomically(folder / "poses.csv", _csv(columns, rows))
    write_atomically(folder / "campaign.toml", text)
    campaign = read_campaign(folder, joint_names, orientations=True)
    n_poses = counted(len(campaign.poses), "pose")
    return f"{folder}: {n_poses}, {counted(len(points), 'target')}"


_XYZ = ("x_mm", "y_mm", "z_mm")


def _csv(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def _times_s(table: ForeignTable, meant: Understood) -> list[float] | None:
    """Return times from the first row on; None where they do not rise."""
    if meant.time is None:
        return None
    times = table.numbers[meant.time]
    if not np.isfinite(times).all() or np.any(np.diff(times) < 0.0):
        return None
    # Nanoseconds or milliseconds since 1970 are too large for seconds.
    scale = 1e-9 if times[0] > 1e15 else 1e-3 if times[0] > 1e11 else 1.0
    scale = TIMES.get(unit_of_column(meant.time) or "", scale)
    seconds: list[float] = (scale * (times - times[0])).tolist()
    return seconds


def _points(
    table: ForeignTable, meant: Understood
) -> tuple[list[str], list[list[object]]]:
    """Name the target of each row; equal places have one name."""
    labels = table.texts.get(meant.label or "", ("",) * table.n_rows)
    names: dict[tuple[float, ...], str] = {}
    names_in_use: set[str] = set()
    features = []
    for index, place_mm in enumerate(meant.places_mm.tolist()):
        key = tuple(place_mm)
        if key not in names:
            name = labels[index] if labels[index] not in names_in_use else ""
            names[key] = name or f"P{index + 1}"
            names_in_use.add(names[key])
        features.append(names[key])
    return features, [[name, *place_mm] for place_mm, name in names.items()]
