import json
import os
import pty
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.simulated import written
from tests.running import END_S, run_traverse
from traverse.kinematics.arm_file.arm import effect_from_table, read_arm, write_arm

COMMENT = "# Measured on a Friday."
ECCENTRIC = {
    "kind": "encoder_eccentricity",
    "joint": "J3",
    "cos_rad": 8.0e-5,
    "sin_rad": -3.0e-5,
}


def run_diagnose(
    folder: Path, *arguments: str, status: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run it in a folder, its output piped; warnings are errors."""
    return run_traverse(folder, "diagnose", *arguments, status=status)


@pytest.fixture(scope="session")
def campaign_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a campaign in which J3 reads wrongly, and the design."""
    folder = tmp_path_factory.mktemp("eccentric")
    spoilt = measured().with_effect(effect_from_table(ECCENTRIC))
    # Few poses with few columns: quick.
    plain = replace(
        spoilt.campaign.poses.part(slice(0, None, 2)),
        temperature_c=None,
        joint_temperatures_c=None,
        approaches=None,
        speeds_rad_s=None,
        directions=None,
        force_n=None,
    )
    (folder / "campaign").mkdir()
    written(replace(spoilt.campaign, poses=plain), folder / "campaign")
    write_arm(folder / "arm.toml", spoilt.arm)
    text = (folder / "arm.toml").read_text("utf-8")
    (folder / "arm.toml").write_text(f"{COMMENT}\n{text}", "utf-8")
    return folder


@pytest.fixture(scope="session")
def diagnosed(campaign_folder: Path) -> Path:
    """The folder after a diagnosis, the output in `said` and `errors`."""
    ran = run_diagnose(campaign_folder, "campaign", "--arm", "arm.toml", "--out", "out")
    (campaign_folder / "said").write_text(ran.stdout, "utf-8")
    (campaign_folder / "errors").write_text(ran.stderr, "utf-8")
    return campaign_folder


def test_the_effect_is_named_written_and_told(diagnosed: Path) -> None:
    lines = (diagnosed / "said").read_text("utf-8").splitlines()
    assert lines[0].endswith("verdict: named")
    assert lines[1] == "state: good"
    assert lines[2].startswith("Missing effect: encoder eccentricity, joint J3 (")
    assert lines[-1].startswith("wrote out: arm.toml, arm.cov.npz, diagnosis.json")
    (effect,) = read_arm(diagnosed / "out" / "arm.toml").effects
    assert (effect.kind, effect.joint) == ("encoder_eccentricity", "J3")
    assert read_arm(diagnosed / "arm.toml").effects == ()
    values = json.loads((diagnosed / "out" / "diagnosis.json").read_text("utf-8"))
    assert values["verdict"] == "named"
    assert (diagnosed / "out" / "report.html").stat().st_size > 100_000


def test_progress_is_quiet_where_it_is_piped(diagnosed: Path) -> None:
    assert (diagnosed / "errors").read_text("utf-8") == ""


@pytest.mark.slow
def test_accepted_in_place_as_json_and_strict(diagnosed: Path, tmp_path: Path) -> None:
    shutil.copytree(diagnosed / "campaign", tmp_path / "campaign")
    shutil.copy(diagnosed / "arm.toml", tmp_path / "arm.toml")
    ran = run_diagnose(
        tmp_path,
        *("campaign", "--arm", "arm.toml", "--out", "out"),
        *("--accept", "--json", "--strict"),
        status=1,
    )
    document = json.loads(ran.stdout)
    first = json.loads((diagnosed / "out" / "diagnosis.json").read_text("utf-8"))
    for values in (document, first):
        assert values.pop("provenance")["campaign"]["name"] == "campaign"
    assert document == first
    accepted = read_arm(tmp_path / "arm.toml")
    assert accepted == read_arm(tmp_path / "out" / "arm.toml")
    assert accepted.identification is not None
    assert len(accepted.effects) == 1
    assert (tmp_path / "arm.toml").read_text("utf-8").startswith(COMMENT)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"campaign", "arm.toml", "arm.cov.npz", "out"}


@pytest.mark.slow
def test_progress_is_reported_on_a_terminal(diagnosed: Path, tmp_path: Path) -> None:
    leader, follower = pty.openpty()
    arguments = ["campaign", "--arm", "arm.toml", "--out", str(tmp_path / "out")]
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", "traverse", "diagnose", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=follower,
            cwd=diagnosed,
        )
        os.close(follower)
        output = b""
        while b" % " not in output:
            output += os.read(leader, 4096)  # fails where it ends without
        process.kill()
        process.wait(END_S)
    finally:
        os.close(leader)


def test_a_plan_looks_at_no_misclosure(campaign_folder: Path) -> None:
    ran = run_diagnose(campaign_folder, "campaign", "--arm", "arm.toml", "--plan")
    lines = ran.stdout.splitlines()
    assert "what 120 poses could show" in lines[0]
    assert any(
        line.startswith("encoder eccentricity, joint J3") and " from " in line
        for line in lines
    )
    assert any("cannot be seen: " in line for line in lines)
    ran = run_diagnose(
        campaign_folder, "campaign", "--arm", "arm.toml", "--plan", "--json"
    )
    values = json.loads(ran.stdout)
    assert {entry["kind"] for entry in values["detectable"]} >= {"encoder_scale"}


def test_what_is_missing_is_said(campaign_folder: Path) -> None:
    ran = run_diagnose(
        campaign_folder, "campaign", "--arm", "arm.toml", "--plan", "--accept", status=2
    )
    assert "--plan writes nothing" in ran.stderr
    ran = run_diagnose(campaign_folder, "campaign", "--arm", "arm.toml", status=2)
    assert "--out missing" in ran.stderr
    ran = run_diagnose(campaign_folder, "campaign", "--out", "out2", status=2)
    assert "--arm" in ran.stderr
    ran = run_diagnose(
        campaign_folder, "nowhere", "--arm", "arm.toml", "--out", "out2", status=2
    )
    assert "nowhere" in ran.stderr
    assert not (campaign_folder / "out2").exists()


def test_another_arm_is_refused(campaign_folder: Path, tmp_path: Path) -> None:
    arm = read_arm(campaign_folder / "arm.toml")
    write_arm(
        tmp_path / "short.toml", arm.model_copy(update={"joints": arm.joints[1:]})
    )
    ran = run_diagnose(
        campaign_folder,
        *("campaign", "--arm", str(tmp_path / "short.toml"), "--out", "out2"),
        status=2,
    )
    assert "Traceback" not in ran.stderr
