"""Measurements of other people's arms, as campaigns and arm files.

Held-out poses follow a rule that was fixed before any result was computed:
every third place of a gauge, a series of its own, or the owner's own test.
"""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from traverse.arrays import Booleans, Floats
from traverse.cli.__main__ import app

# Universal Robots' nominal tables (mm, degrees): d of the six rows, and two a.
_UR_ALPHA_DEG = (90.0, 0.0, 0.0, 90.0, -90.0, 0.0)
UR5_MM = ((89.159, 0.0, 0.0, 109.15, 94.65, 82.3), (-425.0, -392.25))
UR10_MM = ((127.3, 0.0, 0.0, 163.941, 115.7, 92.2), (-612.0, -572.3))
_UR_JOINTS = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
)
GAUGE_MM = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """One arm's measurements.

    Attributes:
        owners: the owners' own figures, in words.
        arm: options of `traverse arm from-urdf` or `from-dh`, by the words before them.
        angles_rad: readings, (n, n_joints).
        places_mm: where a tracker saw the point, (n, 3); None: a ball in sockets.
        sockets: name of the gauge's place and its socket, 1 or 2, of each pose.
        is_kept: whether a pose takes no part in the identification, (n,).
        was_moved: the tracker was moved for these, which determine its place.
    """

    name: str
    held_by: str
    owners: str
    arm: tuple[str, ...]
    angles_rad: Floats
    places_mm: Floats | None
    sockets: Sequence[tuple[str, str]]
    is_kept: Booleans
    was_moved: bool = False

    def write(self, folder: Path, rows: Booleans) -> Path:
        folder.mkdir(parents=True)
        n_joints = self.angles_rad.shape[1]
        lines = ['schema = "traverse/campaign/1"', 'poses = "poses.csv"']
        lines.append('time = "order"')
        selected = np.flatnonzero(rows)
        if self.places_mm is None:
            for place in dict.fromkeys(self.sockets[int(row)][0] for row in selected):
                lines += ["[[artefacts]]", f'id = "{place}"', 'kind = "seats"']
                lines += [f"distance_mm = {GAUGE_MM}"]
        else:
            lines += ["[[artefacts]]", 'id = "tracker"', 'kind = "points"']
            lines += ['frame = "own"', 'points_mm = "points.csv"']
            named = [[f"p{row}", *self.places_mm[row].tolist()] for row in selected]
            _write(folder / "points.csv", ["feature", "x_mm", "y_mm", "z_mm"], named)
        (folder / "campaign.toml").write_text("\n".join(lines) + "\n", "utf-8")
        head = ["time_s", "artefact", "feature"]
        head += [f"{name}_rad" for name in self.joints(n_joints)]
        poses = [
            [row, *self._touched(row), *map(repr, self.angles_rad[row].tolist())]
            for row in selected.tolist()
        ]
        _write(folder / "poses.csv", head, poses)
        return folder

    def joints(self, n_joints: int) -> list[str]:
        return [f"J{number}" for number in range(1, n_joints + 1)]

    def _touched(self, row: int) -> tuple[str, str]:
        return (
            ("tracker", f"p{row}") if self.places_mm is not None else self.sockets[row]
        )


def read_sets(folder: Path) -> Iterator[Measured]:
    """Read the sets that are in a folder, under the names of their repositories."""
    for robot, owners in _GAUGED.items():
        if (folder / "mukca" / robot).is_dir():
            yield _gauged(folder / "mukca", robot, owners)
    if (folder / "ur5").is_dir():
        yield _ur5(folder / "ur5")
    if (folder / "ipa-ur10").is_dir():
        yield from _ipa(folder / "ipa-ur10")
    if (folder / "ur10").is_dir():
        yield _figaroh(folder / "ur10" / "calibration.csv")


def make_arm(measured: Measured, folder: Path) -> Path:
    """Make the nominal arm's file, by `traverse arm`.

    Raises:
        ValueError: the command refused, in its words.
    """
    arm = folder / "arm.toml"
    command, *words = measured.arm
    if command == "from-dh":
        table, *words = words
        (folder / "dh.csv").write_text(table, "utf-8")
        words = [str(folder / "dh.csv"), *words]
    result = CliRunner().invoke(app, ["arm", command, *words, "-o", str(arm)])
    if result.exit_code:
        raise ValueError(result.output)
    text = arm.read_text("utf-8")
    for number, name in enumerate(_joint_names(text), start=1):
        text = text.replace(f'name = "{name}"', f'name = "J{number}"')
    arm.write_text(text, "utf-8")
    return arm


_GAUGED: Mapping[str, str] = {
    "panda_1": "mean 8.28 -> 0.168 mm, at other places 7.79 -> 0.347 mm",
    "panda_2": "-",
    "kuka_14": "-",
}
_URDF = {"panda_1": "panda.urdf", "panda_2": "panda.urdf", "kuka_14": "iiwa14.urdf"}


def _gauged(folder: Path, robot: str, owners: str) -> Measured:
    """A ball on the flange, put into two sockets of a gauge at several places."""
    angles, sockets, kept = [], [], []
    for number, place in enumerate(sorted((folder / robot).iterdir())):
        for hole in (0, 1):
            text = (place / f"hole_{hole}.csv").read_text("utf-8")
            for line in filter(str.strip, text.splitlines()):
                angles.append([float(cell) for cell in line.split(",")])
                sockets.append((place.name, str(hole + 1)))
                kept.append(number % 3 == 1)
    arm = ("from-urdf", str(folder / _URDF[robot]), "--tip", "ball_link")
    return Measured(
        robot,
        "every third place",
        owners,
        (*arm, "--name", robot),
        np.array(angles),
        None,
        sockets,
        np.array(kept),
    )


def _ur5(folder: Path) -> Measured:
    tables = [_cells(folder / name) for name in ("grid.csv", "random.csv")]
    rows = [row for table in tables for row in table]
    target = np.array([[float(row[f"{a}_t"]) for a in "xyz"] for row in rows])
    off = np.array([[float(row[f"{a}_dif"]) for a in "xyz"] for row in rows])
    degrees = [[float(row[f"joint_{k}"]) for k in range(1, 7)] for row in rows]
    return Measured(
        "ur5",
        "the owner's 20 test postures",
        "mean 2.566 -> 0.155 mm (with a graph neural network)",
        _universal(UR5_MM, "ur5"),
        np.radians(degrees),
        target - off,
        [("", "")] * len(rows),
        np.arange(len(rows)) >= len(tables[0]),
    )


def _ipa(folder: Path) -> Iterator[Measured]:
    """Two series of one arm: C is judged by its own rest, and by series B."""
    c, b = (_cells(folder / f"series-{name}.csv", ";") for name in "cb")
    used = c[:800]
    for name, kept, held_by in (
        ("ipa-ur10, C", c[800:], "the other 1973 postures of series C"),
        ("ipa-ur10, C on B", b, "series B"),
    ):
        rows = [*used, *kept]
        yield Measured(
            name,
            held_by,
            "-",
            _universal(UR10_MM, "ur10"),
            np.array([[_german(row[joint]) for joint in _UR_JOINTS] for row in rows]),
            np.array(
                [[_german(row[f"measurement_{a}"]) for a in "xyz"] for row in rows]
            ),
            [("", "")] * len(rows),
            np.arange(len(rows)) >= len(used),
            was_moved=kept is b,
        )


def _figaroh(path: Path) -> Measured:
    rows = _cells(path)
    return Measured(
        "ur10",
        "every third posture",
        "10.6 -> 2.3 mm rms, of the postures used",
        _universal(UR10_MM, "ur10"),
        np.array([[float(row[joint]) for joint in _UR_JOINTS] for row in rows]),
        1000.0 * np.array([[float(row[f"{a}1"]) for a in "xyz"] for row in rows]),
        [("", "")] * len(rows),
        np.arange(len(rows)) % 3 == 1,
    )


def _universal(
    lengths_mm: tuple[Sequence[float], Sequence[float]], name: str
) -> tuple[str, ...]:
    d_mm, (upper_mm, fore_mm) = lengths_mm
    a_mm = (0.0, upper_mm, fore_mm, 0.0, 0.0, 0.0)
    table = "a_mm,d_mm,alpha_rad\n" + "".join(
        f"{a},{d},{math.radians(alpha)!r}\n"
        for a, d, alpha in zip(a_mm, d_mm, _UR_ALPHA_DEG, strict=True)
    )
    tool = ("--tool-xyz-mm", "0,0,50")
    return ("from-dh", table, "--convention", "classic", *tool, "--name", name)


def _joint_names(text: str) -> list[str]:
    blocks = text.split("[[joints]]")[1:]
    return [block.split('name = "', 1)[1].split('"', 1)[0] for block in blocks]


def _german(cell: str) -> float:
    return float(cell.replace(",", "."))


def _cells(path: Path, separator: str = ",") -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter=separator))


def _write(
    path: Path, head: Sequence[object], rows: Sequence[Sequence[object]]
) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])
