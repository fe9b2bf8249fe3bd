import csv
import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.identify.identification import run_identify, said_json
from tests.docs.pages import text_of
from tests.lab.simulated import TrueArm, arm_value, rotations, seven_joints
from tests.running import run_traverse
from traverse.kinematics.arm_file.arm import write_arm

PAGE = "docs/how-to/campaign-from-a-table.md"
N_POSTURES = 60
NOISE_MM = 0.05


def block(language: str) -> str:
    match = re.search(rf"^```{language}\n(.*?)^```$", text_of(PAGE), re.M | re.S)
    assert match is not None
    return match[1]


def six_joints() -> TrueArm:
    arm = seven_joints()
    return TrueArm(arm.axes[:6], arm.links_mm[:6], np.zeros(6), np.zeros(3))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A table of an arm that differs from its file, and that file."""
    design = six_joints()
    true = TrueArm(
        design.axes,
        design.links_mm + np.array([0.0, 0.4, -0.7]),
        design.zeros_rad,
        design.origin_mm,
    )
    rng = np.random.default_rng(4)
    angles = rng.uniform(-2.5, 2.5, (N_POSTURES, 6))
    turn = rotations(np.array([0.6, 0.0, 0.8]), np.array([2.0]))[0]
    seen_mm = true.centres(angles) @ turn.T + np.array([3000.0, 200.0, -500.0])
    seen_mm += rng.normal(size=seen_mm.shape) * NOISE_MM
    with (tmp_path / "table.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(block("text").splitlines()[0].split(","))
        for position, reading in zip(seen_mm / 1000.0, np.degrees(angles), strict=True):
            writer.writerow([*position, *reading])
    write_arm(tmp_path / "arm.toml", arm_value(design))
    return tmp_path


@pytest.mark.slow
def test_a_table_becomes_a_campaign_that_identifies_the_arm(folder: Path) -> None:
    command = "traverse campaign from-table table.csv --arm arm.toml -o campaign"
    assert f"$ {command}\n" in text_of(PAGE)
    run_traverse(folder, *command.split()[1:], "--yes")
    file = folder / "campaign" / "campaign.toml"
    file.write_text(file.read_text("utf-8") + block("toml"), "utf-8")
    arguments = ("campaign", "--arm", "arm.toml", "--json")
    assert "predict campaign --arm arm.toml --fit-tool" in text_of(PAGE)
    frames = said_json(run_traverse(folder, "predict", *arguments, "--fit-tool"))
    kept = ("--out", "result", "--holdout", "0.3")
    all_free = said_json(run_identify(folder, *arguments, *kept))
    assert len(all_free["parameters"]) == 4 * 6 - 3
    assert frames["distance_mm"]["mean_mm"] > 10.0 * NOISE_MM
    # The mean length of three normals is 1.6 of their standard deviation; an arm that
    # was identified with 42 poses adds its own uncertainty.
    left_mm = all_free["holdout"]["distance_mm"]["after"]["mean_mm"]
    assert 1.2 * NOISE_MM < left_mm < 3.0 * NOISE_MM
    assert all_free["global_test"]["p_value"] > 1e-3
