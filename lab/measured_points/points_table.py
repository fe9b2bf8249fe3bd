"""Exported points as what was measured: a table with a line a point."""

import csv
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.measured_points.measurement import Measurement, measurement_of_touches
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    shown,
    unknown_name_message,
)

_PLACE = ("x_mm", "y_mm", "z_mm")
_COLUMNS = ("artefact", "feature", *_PLACE)


def is_point_table(path: Path) -> bool:
    """Say whether a table has coordinates in place of readings."""
    return path.suffix == ".csv" and _PLACE[0] in _header(path)


def _header(path: Path) -> list[str]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return [name.strip() for name in next(csv.reader(file), [])]
    except (OSError, UnicodeDecodeError, csv.Error):
        return []  # whose reader says what is wrong


def read_points_table(path: Path, file: CampaignFile, arm: Arm) -> Measurement:
    """Read a table of points: artefact, feature, x_mm, y_mm, z_mm, in any order.

    Of further columns temperature_c and probe_radius_mm are looked at, no others.
    """
    header = _header(path)
    problems = [
        Problem("line 1", f"column '{name}' is missing; add it")
        for name in _COLUMNS
        if name not in header
    ]
    if problems:
        raise FileError(str(path), problems)
    artefacts = {artefact.id: artefact for artefact in file.artefacts}
    names: tuple[list[str], list[str]] = ([], [])
    numbers: list[list[float]] = []
    with path.open(encoding="utf-8-sig", newline="") as lines:
        reader = csv.DictReader(lines, fieldnames=header)
        next(reader)
        for row in reader:
            where, name = f"line {reader.line_num}", row["artefact"] or ""
            if name not in artefacts:
                message = unknown_name_message("artefact", name, artefacts)
                problems.append(Problem(where, message))
                continue
            try:
                place = [float(row[column]) for column in _PLACE]
                warm = float(row.get("temperature_c") or "nan")
                tip_mm = float(row.get("probe_radius_mm") or arm.probe.radius_mm)
            except (TypeError, ValueError):
                cells = [row[column] for column in _PLACE]
                problems.append(Problem(where, f"{shown(cells)} are not three numbers"))
                continue
            if not np.all(np.isfinite(place)):
                problems.append(Problem(where, f"{shown(place)} is not finite"))
            names[0].append(name)
            names[1].append(row["feature"] or "")
            numbers.append([*place, warm, tip_mm])
    if not numbers and not problems:
        problems.append(Problem("", "holds no points; measure some"))
    if problems:
        raise FileError(str(path), problems)
    return measurement_of_touches(arm, artefacts, names, np.array(numbers), ())
