import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.identify.identification import run_identify, said_json
from tests.results import ARM, write_simulated
from tests.running import run_traverse

N_POSES = 120


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("predicted")
    write_simulated(folder, "cones+bar", N_POSES)
    ran = run_identify(
        folder,
        *("campaign", "--arm", "arm.toml", "--out", "out"),
        *("--holdout", "0.3", "--seed", "2"),
    )
    (folder / "said").write_text(ran.stdout, "utf-8")
    return folder


def predicted(folder: Path, *arguments: str) -> Any:
    return said_json(run_traverse(folder, "predict", *arguments, "--json"))


def test_poses_kept_aside_are_predicted_before_and_after(folder: Path) -> None:
    document = json.loads((folder / "out" / "identification.json").read_text("utf-8"))
    holdout = document["holdout"]
    before, after = (holdout["distance_mm"][of] for of in ("before", "after"))
    assert (holdout["by"], holdout["seed"]) == ("time", 2)
    assert before["n"] == after["n"]
    assert 0.25 * N_POSES <= after["n"] <= 0.35 * N_POSES
    n_used = sum(entry["n"] for entry in document["artefacts"].values())
    assert n_used + after["n"] + len(document["excluded"]) == N_POSES
    assert after["mean_mm"] < 0.03
    assert before["mean_mm"] > 0.1
    text = (folder / "said").read_text("utf-8")
    assert f"Kept aside: {after['n']} poses, chosen by time (seed 2)" in text
    assert "Kept aside" in (folder / "out" / "report.html").read_text("utf-8")


def test_whole_artefacts_can_be_kept_aside(folder: Path) -> None:
    arguments = ("--holdout", "0.3", "--holdout-by", "artefact", "--json")
    document = said_json(
        run_identify(folder, "campaign", "--arm", "arm.toml", "--out", "a", *arguments)
    )
    kept_aside = document["holdout"]["artefacts"]
    assert not set(kept_aside) & set(document["artefacts"])
    assert {entry["placed_by"] for entry in kept_aside.values()} == {"itself"}


def test_too_few_poses_to_keep_any_aside_are_refused(tmp_path: Path) -> None:
    write_simulated(tmp_path, "cones", 10)
    ran = run_identify(
        tmp_path,
        *("campaign", "--arm", "arm.toml", "--out", "o", "--holdout", "0.3"),
        status=2,
    )
    assert "nothing can be kept aside of 10 poses at 5 artefacts by time" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_an_arm_is_judged_by_another_campaign_s_places(folder: Path) -> None:
    write_simulated(folder / "second", "cones+bar", 120)
    same = predicted(folder, "second/campaign", "--arm", "out/arm.toml")
    arguments = ("--fit-on", "campaign")
    answer = predicted(folder, "second/campaign", "--arm", "out/arm.toml", *arguments)
    design = predicted(folder, "second/campaign", "--arm", "arm.toml", *arguments)
    assert {e["placed_by"] for e in same["artefacts"].values()} == {"itself"}
    assert {e["placed_by"] for e in answer["artefacts"].values()} == {"others"}
    assert answer["distance_mm"]["n"] == 120
    assert answer["distance_mm"]["mean_mm"] < 0.1 * design["distance_mm"]["mean_mm"]


def test_the_table_has_a_line_for_each_pose(folder: Path) -> None:
    ran = run_traverse(
        folder, "predict", *("campaign", "--arm", "out/arm.toml", "--out", "poses.csv")
    )
    assert "artefacts placed by the same poses: cone-1" in ran.stdout
    assert "tool: of the arm file" in ran.stdout
    assert ran.stdout.splitlines()[-1] == "wrote poses.csv"
    with (folder / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["line"]) for row in rows] == list(range(2, 2 + N_POSES))
    for row in rows:
        parts = [float(row[f"w{k}_mm"]) for k in (1, 2, 3) if row[f"w{k}_mm"]]
        assert len(parts) == (1 if row["artefact"] == "bar" else 3)
        assert float(row["distance_mm"]) == pytest.approx(
            np.linalg.norm(parts), rel=1e-4
        )


def test_the_tool_is_fitted_on_request(folder: Path) -> None:
    text = ARM.read_text("utf-8")
    (folder / "bent.toml").write_text(
        text.replace("vector_mm = [85.0, ", "vector_mm = [85.5, ")
    )
    arguments = ("campaign", "--arm", "bent.toml")
    answer = predicted(folder, *arguments, "--fit-tool")
    assert len(answer["probe_vector_mm"]) == 3
    plain = predicted(folder, *arguments)
    assert plain["probe_vector_mm"] is None
    assert answer["distance_mm"]["rms_mm"] < plain["distance_mm"]["rms_mm"]


def test_an_arm_of_other_joints_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "campaign", tmp_path / "campaign")
    text = ARM.read_text("utf-8").replace('name = "J1"', 'name = "A1"')
    (tmp_path / "arm.toml").write_text(text, "utf-8")
    ran = run_traverse(tmp_path, "predict", "campaign", "--arm", "arm.toml", status=2)
    assert "A1_rad" in ran.stderr
