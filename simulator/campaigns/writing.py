"""Writes a campaign as a folder, numbers to the bit, with its truth."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

    The arm file, a start for identification, has no effects.
    """
    folder.mkdir(parents=True, exist_ok=True)
    campaign = simulated.campaign
    noise = campaign.encoder_rad, campaign.contact_mm, campaign.orientation_rad
    text = campaign_text(campaign.artefacts, campaign.start_utc, noise)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for artefact in campaign.artefacts:
        if _has_many_points(artefact):
            text = "".join(_point_lines(artefact.table["points_mm"]))
            (folder / _points_name(artefact)).write_text(text, encoding="utf-8")
    with (folder / "poses.csv").open("w", encoding="utf-8", newline="") as file:
        file.writelines(pose_lines(campaign))
    stated = arm.model_copy(update={"effects": ()}) if arm.effects else arm
    write_arm(folder / "arm.toml", stated)
    _write_truth(folder / "truth", simulated.truth, arm)


def campaign_text(
    artefacts: Sequence[StatedArtefact],
    start_utc: str | None,
    noise: Sequence[float | None],
    poses: str = "poses.csv",
) -> str:
    lines = ['schema = "traverse/campaign/1"', f'poses = "{poses}"']
    if start_utc is not None:
        lines.append(f"start_utc = {start_utc}")
    keys = ("encoder_rad", "contact_mm", "orientation_rad")
    stated = [
        (key, std) for key, std in zip(keys, noise, strict=False) if std is not None
    ]
    if stated:
        lines += ["[noise]", *(f"{key} = {std!r}" for key, std in stated)]
    for artefact in artefacts:
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
            lines += [
                f"{name} = {_toml_value(point_mm)}"
                for name, point_mm in points_mm.items()
            ]
    return "\n".join(lines) + "\n"


def pose_lines(campaign: Campaign) -> Iterator[str]:
    columns = list(_columns(campaign))
    yield ",".join(name for names, _ in columns for name in names) + "\n"
    for first in range(0, campaign.n_poses, CHUNK):
        rows = slice(first, first + CHUNK)
        parts = [np.atleast_2d(values[rows].T) for _, values in columns]
        for cells in zip(
            *(_cells(table) for part in parts for table in part), strict=True
        ):
            yield ",".join(cells) + "\n"


def _columns(campaign: Campaign) -> Iterator[tuple[list[str], NDArray[Any]]]:
    """Names of columns with their values, (n,) or (n, n_names), as far as known."""
    joints = campaign.joints
    for names, values in (
        (["time_s"], campaign.time_s),
        (["artefact"], campaign.artefact),
        (["feature"], campaign.feature),
        ([f"{joint}_rad" for joint in joints], campaign.readings_rad),
        (["temperature_c"], campaign.temperature_c),
        ([f"{joint}_approach" for joint in joints], campaign.approach),
        ([f"{joint}_speed_rad_s" for joint in joints], campaign.speed_rad_s),
        (["direction_x", "direction_y", "direction_z"], campaign.direction),
        (["force_n"], campaign.force_n),
        (["length_mm"], campaign.length_mm),
        ([f"orientation_{part}" for part in "wxyz"], campaign.orientation),
    ):
        if values is not None:
            yield names, values


def true_arm_file(arm: Arm, truth: TrueArm) -> Arm:
    """Return an arm file with the true geometry.

    Effects stay; their vectors are turned onto the true axes. The shank's direction is
    stated, since the true last link does not determine it.
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
    if truth.mounting is not None:
        table["mounting"] = truth.mounting.tolist()
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


def _cells(values: NDArray[Any]) -> list[str]:
    """The shortest text of values (n,) that reads back as the same; none for NaN."""
    if values.dtype.kind == "U":
        return [str(text) for text in values]
    texts = list(map(repr, values.tolist()))
    if np.any(np.isnan(values)):
        return ["" if text == "nan" else text for text in texts]
    return texts
