import contextlib
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.importers.urdf_chain import chain_of
from traverse.kinematics.importers.urdf_file import read_urdf
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.strict_toml.problems import FileError

ROBOT = """\
<?xml version="1.0"?>
<robot name="two">
  <!-- metres -->
  <link name="world"/>
  <link name="pedestal"><inertial><mass value="40"/></inertial></link>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2.0"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
    <visual><geometry><mesh filename="upper.stl"/></geometry></visual>
  </link>
  <link name="camera"><inertial><mass value="1.0"/></inertial></link>
  <link name="lower"/>
  <link name="ball"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="pedestal"/><origin xyz="0 0 0.5"/>
  </joint>
  <joint name="pan" type="continuous">
    <parent link="pedestal"/><child link="upper"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="bracket" type="fixed">
    <parent link="upper"/><child link="camera"/><origin xyz="0.3 0 0.1"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0.05 0 0.2" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 2"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="stylus" type="fixed">
    <parent link="lower"/><child link="ball"/>
    <origin xyz="0.4 0 0" rpy="0 1.5707963267948966 0"/>
  </joint>
</robot>
"""


PIECES = [b'"', b"<link name='ball'/>", b"&b;", b"1e308", b"fixed", b"</joint>", b"pan"]


@pytest.fixture
def made(tmp_path):
    def make(text, *options):
        file, out = tmp_path / "robot.urdf", tmp_path / "arm.toml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        words = ["arm", "from-urdf", str(file), "-o", str(out), *options]
        ended = invoke(*words, status=None)
        return ended.exit_code, ended.output.replace(str(file), "FILE"), out

    return make


def test_a_description_becomes_an_arm_with_fixed_joints_merged(made):
    status, output, out = made(ROBOT, "--tip", "ball")
    assert status == 0, output
    arm = read_arm(out)
    assert arm.name == "two"
    assert [joint.name for joint in arm.joints] == ["pan", "lift"]
    assert arm.origin_mm == (0.0, 0.0, 600.0)
    assert [joint.axis for joint in arm.joints] == [(0, 0, 1), (0, 1, 0)]
    assert [joint.link_mm for joint in arm.joints] == [(50, 0, 200), (400, 0, 0)]
    assert arm.probe.direction == (1.0, 0.0, 0.0)
    # Pan carries 2 kg at (0, 0, 100) and the camera's 1 kg at (300, 0, 100).
    assert arm.joints[0].mass_kg == 3.0
    assert arm.joints[0].centre_of_mass_mm == (100.0, 0.0, 100.0)
    assert arm.joints[1].mass_kg is None


def test_the_arm_moves_as_the_description_says(made):
    _, _, out = made(ROBOT, "--tip", "ball", "--tool-xyz-mm", "0,0,20")
    centre_mm, shank = probe_pose(
        geometry_from_arm(read_arm(out)), np.array([[0.3, 0.7]])
    )
    # Lift turns about the child's z, which is the arm's y: the ball moves down.
    across_mm, up_mm = 50 + 420 * math.cos(0.7), 800 - 420 * math.sin(0.7)
    expected = [across_mm * math.cos(0.3), across_mm * math.sin(0.3), up_mm]
    np.testing.assert_allclose(centre_mm[0], expected, atol=1e-9)
    assert shank[0][2] == pytest.approx(-math.sin(0.7), abs=1e-12)


def test_a_joint_that_follows_another_is_coupled_and_has_no_encoder(made):
    follows = '<mimic joint="pan" multiplier="-2" offset="0.25"/><limit'
    text = ROBOT.replace("<limit", follows)
    options = ("--tip", "ball", "--counts-per-turn=4096")
    _, _, free = made(ROBOT, *options)
    pan_rad = np.array([0.3, -0.8])
    readings_rad = np.column_stack([pan_rad, 0.25 - 2 * pan_rad])
    expected_mm, _ = probe_pose(geometry_from_arm(read_arm(free)), readings_rad)
    for posture in ("0,0", "0.4,0"):
        status, output, out = made(
            text, *options, f"--base-posture-rad={posture}", "--force"
        )
        assert status == 0, output
        pan, lift = (arm := read_arm(out)).joints
        assert (lift.coupled_to, lift.ratio, lift.encoder) == ("pan", -2.0, None)
        assert pan.encoder is not None
        # Nothing reads its hinge: the reading stays where it was.
        readings_rad = np.column_stack([pan_rad, np.full(2, lift.zero_rad)])
        found_mm, _ = probe_pose(geometry_from_arm(arm), readings_rad)
        np.testing.assert_allclose(found_mm, expected_mm, atol=1e-9)


def test_another_base_posture_is_the_same_arm(made):
    _, _, out = made(ROBOT, "--tip", "ball")
    readings_rad = np.random.default_rng(1).uniform(-3, 3, (20, 2))
    before_mm, _ = probe_pose(geometry_from_arm(read_arm(out)), readings_rad)
    posture = ("--base-posture-deg", "30,-40", "--force")
    status, _, out = made(ROBOT, "--tip", "ball", *posture, "--counts-per-turn=4096")
    arm = read_arm(out)
    after_mm, _ = probe_pose(geometry_from_arm(arm), readings_rad)
    assert status == 0
    assert arm.joints[0].encoder.source == "base/0"
    np.testing.assert_allclose(after_mm, before_mm, atol=1e-9)


def test_part_of_a_chain_can_be_taken(made):
    status, output, out = made(ROBOT, "--root", "upper", "--tip", "lower")
    assert status == 0, output
    assert [joint.name for joint in read_arm(out).joints] == ["lift"]


def test_of_several_chains_one_is_to_be_said(made):
    status, output, out = made(ROBOT)
    assert status == 2
    assert "say --tip LINK, one of: camera (1 turning), ball (2 turning)" in output
    assert not out.exists()


def test_an_end_that_only_fixed_joints_lead_to_is_no_chain(made):
    flag = (
        '<link name="flag"/><joint name="pole" type="fixed"><parent link="pedestal"/>'
        '<child link="flag"/></joint></robot>'
    )
    without_chain = ROBOT.replace("</robot>", flag).replace(
        '<joint name="bracket" type="fixed">\n    <parent link="upper"/>',
        '<joint name="bracket" type="fixed">\n    <parent link="pedestal"/>',
    )
    status, output, out = made(without_chain)
    assert status == 0, output
    assert len(read_arm(out).joints) == 2


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"revolute"', '"prismatic"', "line 26: joint 'lift' is prismatic: it slides"),
        ('"revolute"', '"planar"', "joint 'lift' is planar"),
        ('"revolute"', '"floating"', "joint 'lift' is floating: nothing holds it"),
        ('"revolute"', '"hinge"', "line 26: joint 'lift': type 'hinge'; revolute,"),
        (
            "<limit",
            '<mimic joint="lift"/><limit',
            "joint 'lift' mimics 'lift'; expected a joint of the chain that turns "
            "freely: pan; or hold it by --hold-rad lift=VALUE",
        ),
        ("<limit", '<mimic joint="pan" multiplier="two"/><limit', "multiplier = 'two'"),
        ('"0 0 2"', '"0 0 0"', "line 29: joint 'lift': the axis has no length"),
        ('"0.4 0 0"', '"0.4 0"', "line 33: <origin> xyz = '0.4 0': expected 3 numbers"),
        ('"0.4 0 0"', '"1e306 0 0"', "expected 3 numbers below 1e6"),
        ('mass value="2.0"', 'mass value="two"', "line 8: <mass> value = 'two'"),
        ('mass value="2.0"', 'mass value="-2"', "line 8: mass -2.0 is negative"),
        ('child link="lower"', 'child link="lover"', "there is no link 'lover'"),
        ('child link="lower"', 'child link="camera"', "both carry 'camera'"),
        ('<parent link="lower"/>', "", "joint 'stylus': has no <parent link="),
        ('joint name="lift"', 'joint name="pan"', "joint 'pan': each needs its own"),
        ('link name="lower"', 'link name="upper"', "link 'upper': each needs its own"),
        ("<robot ", "<robots ", "not XML: mismatched tag"),
        ("<!-- metres -->", "<xacro:arm/>", "line 3: <xacro:arm> is a macro; expand"),
        ('parent link="pedestal"', 'parent link="ball"', "is in a ring"),
    ],
)
def test_a_wrong_description_is_refused(made, old, new, expected):
    assert old in ROBOT
    status, output, out = made(ROBOT.replace(old, new), "--tip", "ball")
    assert status == 2
    assert expected in output
    assert not out.exists()


def test_all_mistakes_are_said_at_once(made):
    wrong = ROBOT.replace('"0 0 2"', '"0 0 0"').replace('value="1.0"', 'value="1,0"')
    _, output, _ = made(wrong.replace('link="lower"/><child', 'link="low"/><child'))
    assert output.startswith("FILE: 3 problems\n")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--tip", "bal"], "--tip: unknown link 'bal'; did you mean 'ball'?"),
        (["--root", "lower", "--tip", "camera"], "leads from 'lower' to 'camera'"),
        (["--tip", "pedestal"], "chain world to pedestal: no joint turns"),
        (["--tip", "ball", "--signs", "1,2"], "joints[1].encoder.sign: 2 is not valid"),
        (["--tip", "ball", "--base-posture-rad", "1"], "'1' is not 2 numbers"),
    ],
)
def test_options_that_do_not_fit_the_description_are_refused(made, options, expected):
    status, output, _ = made(ROBOT, "--counts-per-turn", "4096", *options)
    assert status == 2
    assert expected in output


def test_entities_are_refused_before_anything_is_expanded(made):
    bomb = '<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    text = ROBOT.replace("<robot ", f"{bomb}<robot ").replace('"two"', '"&b;"')
    status, output, _ = made(text)
    assert status == 2
    assert "line 2: has a document type" in output


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b" " * 2_000_001, "is larger than 2000000 bytes"),
        (b"<a>" * 60, "elements stand more than 50 deep"),
        (b"", "not XML: no element found"),
        (b"\xff\xfe\x00", "not XML"),
        (b'<?xml version="1.0" encoding="nowhere"?><robot/>', "not XML"),
        (b"<arm/>", "the root is <arm>, expected <robot>"),
        (b"<robot/>", "no chain of joints leads from a root to an end"),
    ],
)
def test_what_is_no_description_is_refused(made, content, expected):
    status, output, _ = made(content)
    assert status == 2
    assert expected in output


@given(st.data())
def test_a_damaged_description_is_read_or_refused_and_nothing_else(data):
    text = bytearray(ROBOT.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text) - 1))
        stop = start + data.draw(st.integers(0, 60))
        text[start:stop] = data.draw(st.binary(max_size=8) | st.sampled_from(PIECES))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_bytes(text)
        with contextlib.suppress(FileError):
            chain_of(read_urdf(file), None, "ball")


def test_a_file_that_is_not_there_is_refused(tmp_path):
    words = ["arm", "from-urdf", str(tmp_path / "no.urdf"), "-o", str(tmp_path / "a")]
    ended = invoke(*words, status=2)
    assert "cannot be read: No such file or directory" in ended.output


def test_an_arm_becomes_a_description_and_the_same_arm_again(made, tmp_path):
    _, _, first = made(ROBOT, "--tip", "ball", "--counts-per-turn=4096")
    out = tmp_path / "back.urdf"
    words = ["arm", "to-urdf", str(first)]
    ended = invoke(*words, "-o", out)
    assert "lost at the probe over 1000 random postures (seed 1, " in ended.output
    assert "largest 0 mm" in ended.output
    assert invoke(*words).output == out.read_text("utf-8")
    invoke(*words, "-o", out, status=2)
    _, _, repeated = made(out.read_text("utf-8"), "--force", "--counts-per-turn=4096")
    assert read_arm(repeated) == read_arm(first)


def test_an_arm_whose_effects_cannot_be_computed_is_refused(made, tmp_path):
    _, _, arm = made(ROBOT, "--tip", "ball")
    bends = '\n[[effects]]\nkind = "joint_compliance"\njoint = "lift"\n'
    arm.write_text(f"{arm.read_text('utf-8')}{bends}compliance_rad_nm = 1e-6\n")
    ended = invoke("arm", "to-urdf", arm, status=2)
    assert "no mass_kg for lift" in ended.output
