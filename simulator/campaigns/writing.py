"""Writes a campaign as a folder, numbers bit for bit, and the truth beside it."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, Joint, write_arm
from traverse.simulator.arm.truth import TrueArm
from traverse.simulator.campaigns.campaign import (
    Campaign,
    SimulatedCampaign,
    StatedArtefact,
    Truth,
)
from traverse.simulator.effects import on_true_axes

CHUNK = 20_000  # rows in memory as text at a time
MOST_POINTS = 100  # more coordinates than that get a CSV file of their own


def write_campaign(folder: Path, simulated: SimulatedCampaign, arm: Arm) -> None:
    """Write campaign.toml and poses.csv, arm.toml, and a folder truth.

    The arm file, to start an identification from, has no effects: others are to
    find those of the truth.
    """
    folder.mkdir(parents=True, exist_ok=True)
    campaign = simulated.campaign
    (folder / "campaign.toml").write_text(campaign_text(campaign), encoding="utf-8")
    for artefact in campaign.artefacts:
        if _has_many_points(artefact):
            text = "".join(_point_lines(artefact.table["points_mm"]))
            (folder / _points_name(artefact)).write_text(text, encoding="utf-8")
    with (folder / "poses.csv").open("w", encoding="utf-8", newline="") as file:
        file.writelines(pose_lines(campaign))
    stated = arm.model_copy(update={"effects": ()}) if arm.effects else arm
    write_arm(folder / "arm.toml", stated)
    _write_truth(folder / "truth", simulated.truth, arm)


def campaign_text(campaign: Campaign) -> str:
    """The text of campaign.toml."""
    lines = ['schema = "traverse/campaign/1"', 'poses = "poses.csv"']
    if campaign.start_utc is not None:
        lines.append(f"start_utc = {campaign.start_utc}")
    if campaign.encoder_rad is not None and campaign.contact_mm is not None:
        lines += [
            "[noise]",
            f"encoder_rad = {campaign.encoder_rad!r}",
            f"contact_mm = {campaign.contact_mm!r}",
        ]
    for artefact in campaign.artefacts:
        lines += ["[[artefacts]]", f'id = "{artefact.id}"', f'kind = "{artefact.kind}"']
        table = dict(artefact.table)
        if _has_many_points(artefact):
            table["points_mm"] = _points_name(artefact)
        points_mm = table.pop("points_mm", None)
        lines += [f"{key} = {_toml_value(value)}" for key, value in table.items()]
        if isinstance(points_mm, str):
            lines.append(f'points_mm = "{points_mm}"')
        elif points_mm is not None:
            lines.append("[artefacts.points_mm]")
            lines += [f"{name} = {_toml_value(at)}" for name, at in points_mm.items()]
    return "\n".join(lines) + "\n"


def pose_lines(campaign: Campaign) -> Iterator[str]:
    """The lines of poses.csv."""
    yield ",".join(column_names(campaign)) + "\n"
    for first in range(0, campaign.n_poses, CHUNK):
        rows = slice(first, first + CHUNK)
        columns = [_numbers(campaign.time_s[rows])]
        columns += [campaign.artefact[rows].tolist(), campaign.feature[rows].tolist()]
        columns += _by_column(campaign.readings_rad[rows])
        if campaign.temperature_c is not None:
            columns.append(_numbers(campaign.temperature_c[rows]))
        if campaign.approach is not None:
            columns += [list(map(str, c.tolist())) for c in campaign.approach[rows].T]
        if campaign.speed_rad_s is not None:
            columns += _by_column(campaign.speed_rad_s[rows])
        if campaign.direction is not None:
            columns += _by_column(campaign.direction[rows])
        if campaign.force_n is not None:
            columns.append(_numbers(campaign.force_n[rows]))
        if campaign.length_mm is not None:
            columns.append(_numbers(campaign.length_mm[rows]))
        for cells in zip(*columns, strict=True):
            yield ",".join(cells) + "\n"


def column_names(campaign: Campaign) -> list[str]:
    """The header of poses.csv."""
    names = ["time_s", "artefact", "feature"]
    names += [f"{joint}_rad" for joint in campaign.joints]
    if campaign.temperature_c is not None:
        names.append("temperature_c")
    if campaign.approach is not None:
        names += [f"{joint}_approach" for joint in campaign.joints]
    if campaign.speed_rad_s is not None:
        names += [f"{joint}_speed_rad_s" for joint in campaign.joints]
    if campaign.direction is not None:
        names += ["direction_x", "direction_y", "direction_z"]
    if campaign.force_n is not None:
        names.append("force_n")
    if campaign.length_mm is not None:
        names.append("length_mm")
    return names


def true_arm_file(arm: Arm, truth: TrueArm) -> Arm:
    """An arm file with the true geometry in the place of the design's.

    Effects stay; their vectors are turned onto the true axes. The shank's direction
    is stated, since the true last link does not determine it.
    """
    mechanism = truth.mechanism
    vector_mm = np.array(arm.probe.vector_mm)
    ends_mm = np.vstack([mechanism.origins_mm[1:], mechanism.probe_mm - vector_mm])
    links_mm = ends_mm - mechanism.origins_mm
    joints: list[Joint] = []
    for k, joint in enumerate(arm.joints):
        values = {
            "axis": tuple(mechanism.axes[k].tolist()),
            "link_mm": tuple(links_mm[k].tolist()),
            "zero_rad": float(truth.zeros_rad[k]),
        }
        joints.append(joint.model_copy(update=values))
    effects = on_true_axes(arm, arm.effects, mechanism.axes)
    shank = tuple(mechanism.shank.tolist())
    changes: dict[str, Any] = {
        "joints": tuple(joints),
        "probe": arm.probe.model_copy(update={"direction": shank}),
    }
    if effects:
        changes["effects"] = effects
    return arm.model_copy(update=changes)


def _write_truth(folder: Path, truth: Truth, arm: Arm) -> None:
    """Write what the campaign does not state."""
    folder.mkdir(exist_ok=True)
    true = true_arm_file(arm, truth.arm)
    if truth.effects or arm.effects:
        true = true.model_copy(update={"effects": truth.effects})
    write_arm(folder / "arm.toml", true)
    np.savez(
        folder / "noise.npz",
        turns_rad=truth.turns_rad,
        contacts_mm=truth.contacts_mm,
        contact_noise_mm=truth.contact_noise_mm,
        encoder_noise_rad=truth.encoder_noise_rad,
    )
    table = {
        "schema": "traverse/simulated-truth/1",
        "artefacts": [placed.true_table() for placed in truth.artefacts],
        "blunders": [
            {
                "line": blunder.line,
                "kind": blunder.kind,
                "size": None if np.isnan(blunder.size) else blunder.size,
                "unit": blunder.unit,
                "what": blunder.what,
            }
            for blunder in truth.blunders
        ],
        "faults": [repr(fault) for fault in truth.faults],
    }
    text = json.dumps(table, indent=1, allow_nan=False) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8")


def _has_many_points(artefact: StatedArtefact) -> bool:
    return len(artefact.table.get("points_mm", ())) > MOST_POINTS


def _points_name(artefact: StatedArtefact) -> str:
    return f"{artefact.id}.csv"


def _point_lines(points_mm: Mapping[str, list[float]]) -> Iterator[str]:
    yield "feature,x_mm,y_mm,z_mm\n"
    for name, at_mm in points_mm.items():
        yield ",".join([name, *map(repr, at_mm)]) + "\n"


def _toml_value(value: Any) -> str:  # noqa: ANN401 - whatever a table may hold
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, dict):
        pairs = (f"{key} = {_toml_value(entry)}" for key, entry in value.items())
        return "{ " + ", ".join(pairs) + " }"
    return repr(value)


def _by_column(values: Floats) -> list[list[str]]:
    """Cells of an array (n, m), column by column."""
    return [_numbers(column) for column in values.T]


def _numbers(values: Floats) -> list[str]:
    """The shortest text of numbers (n,) that reads back as the same; none for NaN."""
    texts = list(map(repr, values.tolist()))
    if np.any(np.isnan(values)):
        return ["" if text == "nan" else text for text in texts]
    return texts
