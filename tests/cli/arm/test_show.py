import json
import math

import pytest

from tests.kinematics.arms import ARM_TEXT
from tests.running import invoke

MORE = """
[identification]
sigma0 = 1.02
redundancy = 742
date = 2026-11-20T09:00:00Z
parameters = ["J1.axis.v", "J2.link.w"]

[[effects]]
kind = "encoder_eccentricity"
joint = "J2"
cos_rad = 3.1e-5
sin_rad = -1.2e-5
"""


@pytest.fixture
def shown(tmp_path):
    def show(text, *options, status=0):
        file = tmp_path / "arm.toml"
        file.write_text(text, "utf-8")
        return invoke("arm", "show", file, *options, status=status)

    return show


def test_reach_and_step_are_of_the_arm_stretched_out(shown):
    summary = json.loads(shown(ARM_TEXT, "--json").stdout)
    first, second = summary["joints"]
    # J1's link is 10 mm across its axis; behind it 300 mm and 50 mm of probe.
    assert first["reach_mm"] == pytest.approx(10.0 + 350.0)
    assert first["step_at_reach_um"] == pytest.approx(
        360e3 * 2 * math.pi / 8388608, rel=1e-12
    )
    assert second["reach_mm"] == pytest.approx(350.0)
    assert summary["reach_mm"] == pytest.approx(math.hypot(10.0, 250.0) + 350.0)
    assert summary["probe"]["base_posture_mm"] == pytest.approx([1.0, 8.0, 603.5])


def test_a_joint_without_encoder_has_no_step(shown):
    start = ARM_TEXT.index("[joints.encoder]")
    without = ARM_TEXT[:start] + ARM_TEXT[ARM_TEXT.index("[[joints]]", start) :]
    ended = shown(without)
    line = next(line for line in ended.stdout.splitlines() if line.startswith("J1"))
    assert line.split()[-2:] == ["none", "-"]


def test_effects_and_identification_are_listed(shown):
    output = shown(ARM_TEXT + MORE).stdout
    assert (
        "kind=encoder_eccentricity joint=J2 cos_rad=3.1e-05 sin_rad=-1.2e-05" in output
    )
    assert "sigma0: 1.02" in output
    assert "date: 2026-11-20T09:00:00+00:00" in output
    assert "parameters: [J1.axis.v, J2.link.w]" in output
    assert json.loads(shown(ARM_TEXT + MORE, "--json").stdout)["effects"]


def test_the_table_s_columns_stand_below_each_other(shown):
    lines = shown(ARM_TEXT).stdout.splitlines()
    table = lines[2:6]
    assert len({len(line) for line in table}) == 1
    assert "effects   none" in lines
    assert "identified never" in lines


def test_a_wrong_file_is_refused_with_all_that_is_wrong(shown):
    ended = shown(
        ARM_TEXT.replace("sign = -1", "sign = 0").replace("axis", "axes", 1), status=2
    )
    assert "joints[0].axes" in ended.output
    assert "joints[1].encoder.sign" in ended.output


def test_a_covariance_that_cannot_be_read_is_told_beside_the_arm(shown, tmp_path):
    (tmp_path / "c.npz").write_bytes(b"PK, and no archive")
    ended = shown(
        ARM_TEXT + MORE.replace("sigma0", 'covariance_file = "c.npz"\nsigma0')
    )
    assert "no covariance of an arm" in ended.stderr
    assert "covariance_file: c.npz" in ended.stdout
