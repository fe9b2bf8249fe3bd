import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import Result

from tests.drivers.microscribe.fake_arm import TABLE, TEXTS, FakeMicroscribe
from tests.running import invoke
from traverse.cli.devices.microscribe_arm import topic_name
from traverse.daemon.config.schema import read_configuration
from traverse.kinematics.arm_file.arm import read_arm
from traverse.simulator.devices.microscribe import box
from traverse.testing.waiting import until


def made_arm_file(folder: Path, *options: str, status: int = 0) -> Result:
    out = str(folder / "arm.toml")
    words = ["microscribe", "arm-file", "--port", str(folder / "port"), "--out", out]
    return invoke(*words, *options, status=status)


@pytest.fixture
def arm(tmp_path):
    with FakeMicroscribe(tmp_path / "port") as arm:
        yield arm


async def test_both_files_are_written_and_good(arm, tmp_path):
    arm.rewrite(home=(2000, 0, 0, 0, 0, 0))
    result = made_arm_file(tmp_path, "--radius-mm", "1.5")
    assert "MicroScribe 3D 3DX 12345, HCI2 at 115200 baud" in result.output
    made = read_arm(tmp_path / "arm.toml")
    assert made.name == "microscribe-3d-3dx-12345"
    assert made.joints[0].zero_rad == pytest.approx(1.5707963267948966)
    assert {joint.encoder.counts_per_turn for joint in made.joints} == {8000}
    assert made.probe.radius_mm == 1.5
    config = read_configuration(tmp_path / "traverse.toml")
    (device,) = config.device
    assert (device.id, device.driver) == ("microscribe", "microscribe")
    assert device.options.port == str(tmp_path / "port")
    assert device.options.baud_rate == 115200
    assert [entry.source for entry in config.capture.inputs] == [
        "microscribe/0",
        "microscribe/1",
    ]
    await until(lambda: arm.box.baud_rate is None, "the session ends")


def test_the_report_says_what_the_arm_says(arm, tmp_path):
    texts = TEXTS | {box.COMMENT: b"repaired, Beta"}
    arm.rewrite(texts=texts, geometry=TABLE + b"\x00\x20")
    options = ["--json", "--name", "old", "--device", "ms", "--baud-rate", "9600"]
    result = made_arm_file(tmp_path, *options)
    report = json.loads(result.stdout)
    assert report["arm"] == "old"
    assert report["says"]["serial"] == "12345"
    assert report["protocol"] == "HCI2"
    assert report["baud_rate"] == 9600
    assert report["counts_per_turn"] == [8000] * 6
    assert report["beta_rad"] == pytest.approx(32 * 3.141592653589793 / 32768)
    text = (tmp_path / "traverse.toml").read_text("utf-8")
    assert tomllib.loads(text)["device"][0]["baud_rate"] == 9600
    assert read_arm(tmp_path / "arm.toml").joints[5].encoder.source == "ms/5"


def test_files_that_exist_are_kept(arm, tmp_path):
    (tmp_path / "traverse.toml").write_text("mine", "utf-8")
    result = made_arm_file(tmp_path, status=2)
    assert "traverse.toml exists" in result.output
    assert arm.n_sessions == 0
    assert not (tmp_path / "arm.toml").exists()
    made_arm_file(tmp_path, "--force")
    assert (tmp_path / "traverse.toml").read_text("utf-8") != "mine"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--baud-rate", "1200"], "expected one of 9600"),
        (["--device", "a/b"], "letters, digits"),
    ],
)
def test_bad_options_are_refused(arm, tmp_path, options, expected):
    result = made_arm_file(tmp_path, *options, status=2)
    assert expected in result.output


def test_an_arm_with_another_table_is_refused(arm, tmp_path):
    arm.rewrite(texts=TEXTS | {box.FORMAT: b"Format DH0.6"})
    result = made_arm_file(tmp_path, status=2)
    assert "'Format DH0.6', expected 'Format DH0.5'" in result.output
    assert "from-dh" in result.output
    arm.rewrite(texts=TEXTS, geometry=TABLE[:20])
    result = made_arm_file(tmp_path, status=2)
    assert "20 bytes, expected 36" in result.output
    assert list(tmp_path.glob("*.toml")) == []


def test_nobody_at_the_port_is_exit_status_3(tmp_path):
    result = made_arm_file(tmp_path, status=3)
    assert "there is no such port" in result.output


@pytest.mark.parametrize(
    ("expected", "name"),
    [("MicroScribe 3D/X #12", "microscribe-3d-x-12"), ("+/#", "microscribe")],
)
def test_names_can_be_parts_of_topics(expected, name):
    assert topic_name(expected) == name
