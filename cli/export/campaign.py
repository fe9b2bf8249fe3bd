"""Labelled points as a campaign that can be identified, and collected on."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from traverse.cli.common.point_flags import FlaggedPoints
from traverse.cli.export.file import selected_points
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.collection.collection import CollectedTouch, Collection, touch_of
from traverse.lab.collection.plan import targets_of
from traverse.plurals import counted
from traverse.protocol.messages import Point
from traverse.strict_toml.writing import write_atomically


def export_campaign(
    source: Path,
    arm: Path,
    campaign: Path,
    folder: Path,
    *,
    session: str | None,
    flagged: FlaggedPoints,
) -> dict[str, Any]:
    """Write a campaign of points with labels, to a new or empty folder; sum it up.

    The labels must name artefacts of the campaign. Points in doubt are left out.

    Raises:
        ValueError: a file was refused, or a label names nothing of the campaign.
        OSError: a file cannot be read or written.
    """
    if campaign.is_dir():
        campaign /= "campaign.toml"
    file = read_campaign_file(campaign)
    names = [joint.name for joint in read_arm(arm).joints]
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty; name another with --out")
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "campaign.toml", campaign.read_text("utf-8"))
    collection = Collection(file, folder, names, targets_of(file, 1))
    left_out: list[str] = []
    points = selected_points(source, session, retracted=False)
    collection.take_all(_touches(collection, points, left_out, flagged))
    return {
        "folder": str(folder),
        "poses": len(collection.touches),
        "left_out": left_out,
        "flagged": dict(flagged.by_flag),
    }


def campaign_words(report: dict[str, Any], flagged: FlaggedPoints) -> list[str]:
    lines = [f"{report['folder']}: {counted(report['poses'], 'pose')}"]
    if left_out := report["left_out"]:
        lines.append(
            f"{counted(len(left_out), 'point', 'are')} left out, the first: "
            f"{left_out[0]}"
        )
    return lines + flagged.lines()


def _touches(
    collection: Collection,
    points: Iterator[Point],
    left_out: list[str],
    flagged: FlaggedPoints,
) -> Iterator[CollectedTouch]:
    n_joints = len(collection.joint_names)
    for point in points:
        label = point.label
        name = f"point {point.seq} of session {point.session}"
        if label.artefact is None:
            left_out.append(f"{name} has no label")
            continue
        target = collection.target(label.artefact, label.feature or "")
        if target is None:
            touched = f"{label.artefact} {label.feature or ''}".strip()
            raise ValueError(
                f"{name} is labelled {touched!r}, which is not in the campaign; there "
                "are: " + ", ".join(str(t) for t in collection.targets)
            )
        if len(point.angles_rad) != n_joints:
            raise ValueError(
                f"{name} has {counted(len(point.angles_rad), 'angle')}, but the arm "
                "has "
                f"{counted(n_joints, 'joint')}; give the arm file that it was taken "
                "with"
            )
        if bad := flagged.leaves_out(point.quality.flags):
            left_out.append(f"{name} is flagged {', '.join(bad)}")
            continue
        yield touch_of(point, target, None, None)
