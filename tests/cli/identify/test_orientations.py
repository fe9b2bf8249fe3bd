import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.cli.identify.identification import run_identify, said_json
from tests.running import run_traverse
from tests.simulator.effects.examples import heavy_arm
from traverse.kinematics.arm_file.arm import write_arm
from traverse.simulator.campaigns.command import campaign_made

pytestmark = pytest.mark.slow

SPEC = """\
schema = "traverse/simulated-campaign/1"
arm = "arm.toml"
seed = 3
[noise]
contact_mm = 0.02
orientation_rad = 5e-5
blunder_share = 0.02
blunder_kinds = ["orientation"]
[[artefacts]]
id = "tracker"
kind = "points"
n_poses = 100
n_points = 100
size_mm = 450.0
orientations = true
"""
N_POSES = 100
N_WRONG = round(0.02 * N_POSES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("oriented")
    write_arm(folder / "arm.toml", heavy_arm())
    (folder / "spec.toml").write_text(SPEC, "utf-8")
    assert campaign_made(folder / "spec.toml", folder / "campaign", None) == 0
    ran = run_identify(
        folder, *("campaign", "--arm", "arm.toml", "--out", "out", "--holdout", "0.2")
    )
    (folder / "said").write_text(ran.stdout, "utf-8")
    return folder


def read_poses(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_the_simulator_writes_orientations_that_scipy_understands(folder: Path) -> None:
    truth = json.loads((folder / "campaign" / "truth" / "truth.json").read_text())
    wrong = {blunder["line"] for blunder in truth["blunders"]}
    assert {blunder["kind"] for blunder in truth["blunders"]} == {"orientation"}
    assert len(wrong) == N_WRONG
    (placed,) = truth["artefacts"]
    mounting, frame = (np.array(m) for m in (truth["mounting"], placed["rotation"]))
    for mine in (mounting, frame):
        assert mine.T @ mine == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(mine) == pytest.approx(1.0)
    rows = read_poses(folder / "campaign" / "poses.csv")
    quaternions = [[float(row[f"orientation_{c}"]) for c in "wxyz"] for row in rows]
    seen = Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
    # From the arm as it truly is, by its file and its turns, without any of our code.
    arm = (folder / "campaign" / "truth" / "arm.toml").read_text()
    axes = [
        np.array(json.loads(line.partition("=")[2]))
        for line in arm.splitlines()
        if line.startswith("axis = ")
    ]
    turns_rad = np.load(folder / "campaign" / "truth" / "noise.npz")["turns_rad"]
    body = Rotation.identity(len(rows))
    for axis, turn_rad in zip(axes, turns_rad.T, strict=True):
        body = body * Rotation.from_rotvec(turn_rad[:, None] * axis)
    off = Rotation.from_matrix(frame.T @ body.as_matrix() @ mounting).inv()
    errors_rad = (off * Rotation.from_matrix(seen)).as_rotvec()
    good = [int(line) not in wrong for line in range(2, len(rows) + 2)]
    assert np.std(errors_rad[good]) == pytest.approx(5e-5, rel=0.1)
    sizes_rad = np.linalg.norm(errors_rad, axis=1)[np.logical_not(good)]
    assert sizes_rad == pytest.approx(15 * 5e-5, rel=0.3)


def test_files_and_reports_have_the_orientations(folder: Path) -> None:
    result = json.loads((folder / "out" / "identification.json").read_text("utf-8"))
    orientations = result["orientations"]
    truth = json.loads((folder / "campaign" / "truth" / "truth.json").read_text())
    wrong = [blunder["line"] for blunder in truth["blunders"]]
    lines = [entry["line"] for entry in orientations["excluded"]]
    assert set(lines) <= set(wrong)
    assert result["excluded"] == []
    assert orientations["n"] == orientations["n_all"] - len(lines)
    assert orientations["rms_rad"]["after"] == pytest.approx(5e-5, rel=0.1)
    assert orientations["rms_rad"]["before"] > 1e-3
    assert orientations["noise_rad"] == 5e-5
    assert orientations["sigma0"]["orientations"] == pytest.approx(1.0, abs=0.15)
    assert orientations["sigma0"]["positions"] == pytest.approx(1.0, abs=0.15)
    mounting = orientations["mountings"]["probe"]
    assert np.linalg.norm(mounting["quaternion"]) == pytest.approx(1.0)
    assert max(mounting["std_rad"]) < 5e-5
    # In the base posture of another arm, a little turned.
    away = (
        Rotation.from_quat(mounting["quaternion"], scalar_first=True)
        * Rotation.from_matrix(truth["mounting"]).inv()
    )
    assert away.magnitude() < 0.02
    rows = read_poses(folder / "out" / "residuals.csv")
    left_out = [row["line"] for row in rows if row["orientation_excluded"] == "1"]
    assert left_out == [str(line) for line in lines]
    squares = [
        float(row[f"orientation_{axis}_rad"]) ** 2
        for row in rows
        for axis in "xyz"
        if row["orientation_excluded"] == "0"
    ]
    assert np.sqrt(np.mean(squares)) == pytest.approx(
        orientations["rms_rad"]["after"], rel=1e-4
    )
    kept = result["holdout"]["distance_mm"]["after"]["orientation"]
    assert kept["mean_rad"] < 3e-4
    output = (folder / "said").read_text("utf-8")
    page = (folder / "out" / "report.html").read_text("utf-8")
    for text in (output, page):
        assert f"Orientations of {orientations['n']} poses" in text
        assert "µrad" in text
        assert "sigma0 of positions" in text
        assert "Their orientations are off by" in text
        if lines:
            assert "Orientations that contradict the rest" in text


def test_held_out_orientations_are_predicted(folder: Path) -> None:
    arguments = ("campaign", "--arm", "out/arm.toml", "--out", "poses.csv")
    document = said_json(run_traverse(folder, "predict", *arguments, "--json"))
    orientation = document["distance_mm"]["orientation"]
    assert orientation["n"] == N_POSES
    assert orientation["rms_deg"] == pytest.approx(np.degrees(orientation["rms_rad"]))
    rows = read_poses(folder / "poses.csv")
    sizes_rad = [
        np.linalg.norm([float(row[f"orientation_{axis}_rad"]) for axis in "xyz"])
        for row in rows
    ]
    assert orientation["mean_rad"] == pytest.approx(np.mean(sizes_rad), rel=1e-4)
    assert rows[int(np.argmax(sizes_rad))]["line"] == str(orientation["largest_line"])
    printed = run_traverse(folder, "predict", *arguments, "--fit-on", "campaign").stdout
    assert "all poses: orientation off by" in printed
    assert "degrees) rms" in printed


def test_others_refuse_them_in_words(folder: Path) -> None:
    ran = run_traverse(
        folder,
        *("verify", "campaign", "--standard", "iso10360-12", "--arm", "arm.toml"),
        status=2,
    )
    assert "take measured orientations; leave these columns out" in ran.stderr
    run_traverse(folder, "check", "campaign")


def test_a_diagnosis_writes_its_files(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "campaign", tmp_path / "campaign")
    run_traverse(
        folder, *("diagnose", "campaign", "--arm", "arm.toml", "--out", "found")
    )
    document = json.loads((folder / "found" / "diagnosis.json").read_text("utf-8"))
    assert document["verdict"] == "clean"
    assert document["noise"]["orientation_rad"] == 5e-5
