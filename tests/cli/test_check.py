import json
from pathlib import Path

import pytest
from click.testing import Result

import traverse.cli
from tests.campaign_texts import ONE_CONE
from tests.certificates import Authority
from tests.running import invoke

DATA = Path(traverse.cli.__file__).parent / "demo_data"
DAEMON = '[arm]\nfile = "arm.toml"\n[[device]]\nid = "base"\n{rest}'
DEVICE = 'driver = "latch-board"\nport = "/dev/null"\n'
PROBES = """\
schema = "traverse/probes/1"
[[probes]]
name = "ball-6"
radius_mm = 3.0
vector_mm = [0.0, 0.0, 50.0]
kind = "hard"
"""
NOMINAL = """\
schema = "traverse/nominal/1"
[[points]]
name = "A"
x_mm = 10.0
y_mm = 20.0
z_mm = 0.0
"""


def check(text: str | bytes, folder: Path, *options: str, status: int = 0) -> Result:
    path = folder / "checked.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    (folder / "arm.toml").write_text((DATA / "arm.toml").read_text("utf-8"), "utf-8")
    return invoke("check", *options, path, status=status)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ((DATA / "arm.toml").read_text("utf-8"), "arm file"),
        ((DATA / "simulator.toml").read_text("utf-8"), "simulator's configuration"),
        (DAEMON.format(rest=DEVICE), "daemon's configuration"),
        (PROBES, "probe library"),
        (NOMINAL, "nominal places"),
    ],
)
def test_good_files_are_reported_by_what_they_are(
    text: str, kind: str, tmp_path: Path
) -> None:
    result = check(text, tmp_path)
    assert result.stderr == ""
    name = kind.replace("'s", "")
    assert result.stdout.endswith(f"checked.toml: valid {name}\n")
    report = json.loads(check(text, tmp_path, "--json").stdout)
    assert report == {
        "file": str(tmp_path / "checked.toml"),
        "kind": kind,
        "problems": [],
        "doubts": [],
    }


def test_all_mistakes_of_an_arm_file_are_reported_at_once(tmp_path: Path) -> None:
    text = (DATA / "arm.toml").read_text("utf-8")
    text = text.replace("radius_mm = 3.0", "radius = 3.0")
    text = text.replace("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 0.0]")
    text = text.replace('name = "J3"', 'name = "J2"').replace("2.10", "nan")
    expected = {
        "probe.radius",
        "probe.radius_mm",
        "joints[0].axis",
        "joints[1].zero_rad",
        "joints[2].name",
    }
    result = check(text, tmp_path, status=2)
    assert result.stdout == ""
    assert all(f"  {where}: " in result.stderr for where in expected)
    report = json.loads(check(text, tmp_path, "--json", status=2).stdout)
    assert {problem["where"] for problem in report["problems"]} == expected
    assert all(problem["message"] for problem in report["problems"])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"\xff\xfe", "UTF-8"),
        ("a = ", "line 1"),
        ("", "is empty; expected an arm file"),
        ('schema = "traverse/simulator/1"', "motion: is missing"),
        ("[arm]\nfile = 1", "arm.file: 1 is not a string"),
        ('schema = "traverse/nominal/1"\npoint = 1', "point: "),
        (DAEMON.format(rest=""), "device[0].driver: is missing"),
    ],
)
def test_a_bad_file_is_refused_as_what_it_was_meant_to_be(
    text: str | bytes, expected: str, tmp_path: Path
) -> None:
    assert expected in check(text, tmp_path, status=2).stderr
    report = json.loads(check(text, tmp_path, "--json", status=2).stdout)
    assert report["problems"]


def test_a_configuration_is_checked_with_the_files_that_it_names(
    tmp_path: Path,
) -> None:
    text = DAEMON.format(rest=DEVICE).replace(
        "[[device]]", 'probes = "probes.toml"\n[[device]]'
    )
    stop = '[[quality.end_stops]]\njoint = "J9"\nlow_rad = -1.0\nhigh_rad = 1.0\n'
    (tmp_path / "probes.toml").write_text(PROBES.replace("3.0", "-3.0"))
    result = check(text + stop, tmp_path, status=2)
    assert "probes.toml: 1 problem\n  probes[0].radius_mm: -3.0" in result.stderr
    assert "quality.end_stops[0].joint: 'J9' is no joint of the arm" in result.stderr
    report = json.loads(check(text + stop, tmp_path, "--json", status=2).stdout)
    files = {Path(problem["file"]).name for problem in report["problems"]}
    assert files == {"probes.toml", "checked.toml"}


@pytest.mark.needs("openssl")
def test_certificates_of_a_broker_that_end_soon_or_are_absent_are_doubts(
    tmp_path: Path,
) -> None:
    Authority(tmp_path, "ca")
    section = '[broker]\nhost = "b"\ntls = true\nca_file = "ca.crt"\n'
    result = check(section + DAEMON.format(rest=DEVICE), tmp_path)
    assert "checked.toml: ca_file" in result.stderr
    assert "ca.crt ends on 20" in result.stderr
    (tmp_path / "ca.crt").unlink()
    report = check(section + DAEMON.format(rest=DEVICE), tmp_path, "--json").stdout
    (doubt,) = json.loads(report)["doubts"]
    assert doubt.startswith("broker.ca_file: ")
    assert "cannot be read: No such file" in doubt


@pytest.mark.parametrize("name", ["missing.toml", "."])
def test_what_cannot_be_read_is_refused(name: str, tmp_path: Path) -> None:
    result = invoke("check", tmp_path / name, status=2)
    assert "cannot be read" in result.stderr


POSES = "time_s,artefact,feature,J1_rad,J2_rad\n0.0,seat,,0.1,0.2\n1.0,seat,,0.3,0.4\n"


def test_a_campaign_is_checked_with_its_poses(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(ONE_CONE)
    (tmp_path / "poses.csv").write_text(POSES)
    result = invoke("check", tmp_path)
    assert result.stderr == ""
    assert result.stdout.endswith("campaign.toml: valid campaign\n")
    (tmp_path / "poses.csv").write_text(POSES.replace("1.0,seat", "1.0,seet"))
    result = invoke("check", tmp_path / "campaign.toml", status=2)
    assert "poses.csv" in result.stderr
    assert "line 3: unknown artefact 'seet'; did you mean 'seat'?" in result.stderr
