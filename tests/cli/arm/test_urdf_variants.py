"""Robot descriptions as other programs write them, against transforms by hand."""

import json

import numpy as np
import pytest

from tests.kinematics.importers.matrices import place, rotation
from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.importers.joint_names import names_for_arm
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm

ROBOT = """<robot name="r" xmlns:drake="http://drake.mit.edu" xmlns:q="{q}">
<link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="tip"/>
<joint name="J1" type="continuous"><parent link="base"/><child link="a"/>
  <origin xyz="0.1 0 0.2"/><axis xyz="0 0 1"/></joint>
<joint name="rail" type="prismatic"><parent link="a"/><child link="b"/>
  <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/><axis xyz="0 2 0"/></joint>
<joint name="J2" type="revolute"><parent link="b"/><child link="c"/>
  <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/></joint>
<joint name="J3" type="revolute"><parent link="c"/><child link="tip"/>
  <origin xyz="0.25 0 0"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def ball_mm(j1, rail_mm, j2, j3):
    pose = place((100, 0, 200)) @ rotation([0, 0, 1], j1)
    pose = pose @ place((0, 0, 300), (0.1, 0.2, 0.3)) @ place((0, rail_mm, 0))
    pose = pose @ place((400, 0, 0)) @ rotation([0, 1, 0], j2)
    return (pose @ place((250, 0, 0)) @ rotation([0, 1, 0], j3))[:3, 3]


@pytest.fixture
def made(tmp_path):
    def make(text, *options, status=0):
        file, out = tmp_path / "r.urdf", tmp_path / "arm.toml"
        file.write_text(text, "utf-8")
        words = ("arm", "from-urdf", file, "-o", out, "--force", *options)
        ended = invoke(*words, status=status)
        return ended.output, out

    return make


def balls_mm(out, readings_rad):
    return probe_pose(geometry_from_arm(read_arm(out)), np.array(readings_rad))[0]


def test_a_sliding_joint_is_held_where_an_option_says(made):
    output, _ = made(ROBOT, status=2)
    assert "hold it by --hold-mm rail=VALUE, make it fixed, or choose" in output
    _, out = made(ROBOT, "--hold-mm", "rail=-120.5")
    readings_rad = [[0.3, -0.4, 0.5], [-1.0, 0.2, 1.5]]
    expected = [ball_mm(j1, -120.5, j2, j3) for j1, j2, j3 in readings_rad]
    np.testing.assert_allclose(balls_mm(out, readings_rad), expected, atol=1e-9)
    _, out = made(ROBOT, "--hold-mm", "rail=0", "--hold-rad", "J2=0.7")
    expected = [ball_mm(0.3, 0, 0.7, 1.1)]
    np.testing.assert_allclose(balls_mm(out, [[0.3, 1.1]]), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--hold-mm", "rial=1"], "--hold-mm: unknown joint 'rial'; did you mean 'ra"),
        (["--hold-mm", "J2=1"], "joint 'J2' is revolute, expected prismatic"),
        (["--hold-rad", "rail=1"], "joint 'rail' is prismatic, expected revolute or"),
        (["--hold-mm", "rail"], "'rail' is not of the form JOINT=VALUE"),
        (["--hold-mm", "rail=x"], "'x' is not 1 number below 1e9"),
    ],
)
def test_what_cannot_be_held_is_refused(made, options, expected):
    output, _ = made(ROBOT, *options, status=2)
    assert expected in " ".join(output.split())


def test_a_mimic_of_a_mimic_follows_the_joint_that_turns_freely(made):
    text = ROBOT
    for name, master, ratio, offset in (("J2", "J1", -2, 0.1), ("J3", "J2", 0.5, 0.2)):
        joint = f'<joint name="{name}" type="revolute">'
        mimic = f'<mimic joint="{master}" multiplier="{ratio}" offset="{offset}"/>'
        text = text.replace(joint, joint + mimic)
    _, out = made(text, "--hold-mm", "rail=10")
    arm = read_arm(out)
    followed = [(j.coupled_to, j.ratio) for j in arm.joints[1:]]
    assert followed == [("J1", -2.0), ("J1", -1.0)]
    zeros_rad = [joint.zero_rad for joint in arm.joints]
    j1 = 0.6
    j2 = -2 * j1 + 0.1
    expected = ball_mm(j1, 10, j2, 0.5 * j2 + 0.2)
    places_mm = balls_mm(out, [[j1, *zeros_rad[1:]]])[0]
    np.testing.assert_allclose(places_mm, expected, atol=1e-9)
    # Held, the master holds what mimics it.
    output, _ = made(text, "--hold-mm", "rail=10", "--hold-rad", "J1=0.6", status=2)
    assert "no joint turns" in output


def test_a_mimic_of_a_joint_elsewhere_is_held_or_refused(made):
    finger = (
        '<link name="f"/><joint name="F" type="revolute"><parent link="base"/>'
        '<child link="f"/></joint></robot>'
    )
    follows = '<joint name="J3" type="revolute"><mimic joint="F" multiplier="2"/>'
    text = ROBOT.replace('<joint name="J3" type="revolute">', follows)
    text = text.replace("</robot>", finger)
    options = ("--tip", "tip", "--hold-mm", "rail=0")
    output, _ = made(text, *options, status=2)
    assert "expected a joint of the chain that turns freely: J1, J2" in output
    assert "hold it by --hold-rad J3=VALUE" in output
    for hold in ("J3=0.8", "F=0.4"):
        _, out = made(text, *options, "--hold-rad", hold)
        expected = [ball_mm(0.1, 0, 0.2, 0.8)]
        np.testing.assert_allclose(balls_mm(out, [[0.1, 0.2]]), expected, atol=1e-9)


def test_tags_and_attributes_of_other_tools_are_ignored(made):
    text = ROBOT.replace(
        "</robot>",
        '<drake:collision_filter_group name="g"><drake:member link="a"/>'
        '</drake:collision_filter_group><sensor:camera name="c"/><gazebo/></robot>',
    )
    text = text.replace(
        '<origin xyz="0.4 0 0"/>', '<origin xyz="0.4 0 0" drake:x="1"/>'
    )
    text = text.replace("<axis", '<drake:gear_ratio value="3"/><axis')
    _, out = made(text, "--hold-mm", "rail=0")
    expected = [ball_mm(0.1, 0, 0.2, 0.3)]
    np.testing.assert_allclose(balls_mm(out, [[0.1, 0.2, 0.3]]), expected, atol=1e-9)


XACRO = "http://www.ros.org/wiki/xacro"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("<axis", "<xacro:if/><axis", "line 4: <xacro:if> is a macro; expand the file"),
        ("<axis", "<q:block/><axis", "line 4: <q:block> is a macro; expand the file"),
        ("0.1 0 0.2", "\u22120.1 0 0.2", "expected 3 numbers below 1e6; it has U+2212"),
        ("0.1 0 0.2", "${x} 0 0.2", "<origin> xyz = '${x} 0 0.2' is an expression of"),
        ('name="J2"', 'name="${p}J2"', "<joint> name = '${p}J2' is an expression of"),
        (
            '"0.4 0 0"',
            '"0.4 0 0" scale="2"',
            "line 8: <origin> has the attribute 'scale'",
        ),
        ('"0 0 1"', '"0 0 1" frame="a"', "line 4: <axis> has the attribute 'frame'"),
        (
            '"0.4 0 0"/>',
            '"0.4 0 0"/><mimic joint="J1" delay="2"/>',
            "<mimic> has the attribute 'delay', which is not known here and may move",
        ),
        ('"0.4 0 0"', '"0 0 0" quat_xyzw="0 0 0 2"', "quat_xyzw has the length 2; exp"),
        ('rpy="', 'quat_xyzw="0 0 0 1" rpy="', "<origin> has rpy and quat_xyzw; expec"),
        (
            '"0.4 0 0"/>',
            '"0 0 0"/><origin xyz="1 0 0"/>',
            "has several <origin>; expec",
        ),
        (
            "</robot>",
            '<drake:joint name="b" type="ball"><drake:parent link="a"/></drake:joint>'
            "</robot>",
            "<drake:joint> is a joint of another tool, which cannot be followed",
        ),
        ('<origin xyz="0.4', '<Origin xyz="0.4', "<Origin> is not known; write <orig"),
        ("</robot>", "<Joint/></robot>", "<Joint> is not known; write <joint>"),
    ],
)
def test_what_may_move_the_arm_is_refused_by_its_line(made, old, new, expected):
    text = ROBOT.replace("{q}", XACRO)
    assert old in text
    output, _ = made(text.replace(old, new, 1), "--hold-mm", "rail=0", status=2)
    assert expected in " ".join(output.split())


def test_what_is_ignored_and_may_move_the_arm_is_told(made):
    text = ROBOT.replace('name="r"', 'name="r" units="mm"')
    text = text.replace("<axis", '<pose>1 0 0</pose><limit effort="1"/><axis', 1)
    output, _ = made(text, "--hold-mm", "rail=0")
    assert "units = 'mm' of <robot> is not known here and was ignored" in output
    assert "line 4: <pose> of joint 'J1' is not known here and was ignored" in output
    assert "limit" not in output


def test_a_quaternion_turns_as_roll_pitch_yaw_do(made):
    half = 0.5 * np.array([0.1, 0.2, 0.3])
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    quaternion = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    written = " ".join(map(repr, map(float, quaternion)))
    text = ROBOT.replace('rpy="0.1 0.2 0.3"', f'quat_xyzw="{written}"')
    _, out = made(text, "--hold-mm", "rail=5")
    expected = [ball_mm(0.1, 5, 0.2, 0.3)]
    np.testing.assert_allclose(balls_mm(out, [[0.1, 0.2, 0.3]]), expected, atol=1e-9)


def test_names_that_an_arm_file_cannot_have_are_mapped_and_told(made):
    text = ROBOT.replace('"J1"', '"left/shoulder.yaw"').replace(
        '"J2"', '"Gelenk \u00e4"'
    )
    text = text.replace('"J3"', '"\u80a9"')
    output, out = made(text, "--hold-mm", "rail=0")
    names = [joint.name for joint in read_arm(out).joints]
    assert names == ["left_shoulder_yaw", "Gelenk_a", "J3"]
    assert "joint 'left/shoulder.yaw' is called left_shoulder_yaw\n" in output
    options = (
        "--rename",
        "left/shoulder.yaw=yaw",
        "--rename",
        "\u80a9=elbow",
        "--json",
    )
    output, out = made(text, "--hold-mm", "rail=0", *options)
    names = [joint.name for joint in read_arm(out).joints]
    assert names == ["yaw", "Gelenk_a", "elbow"]
    report = json.loads(output[output.index("{") :])
    assert report["renamed"]["left/shoulder.yaw"] == "yaw"
    for wrong, why in (
        ("J9=a", "unknown joint 'J9'"),
        ("\u80a9=a b", "'a b' is not a joint name"),
        ("J3", "'J3' is not of the form OLD=NEW"),
    ):
        output, _ = made(text, "--rename", wrong, "--hold-mm", "rail=0", status=2)
        assert why in " ".join(output.split())


def test_mapped_names_are_unique_and_good_names_stay():
    names = ["a/b", "a_b", "a.b", "/", "J4", "\u00e9\u00df", "a b"]
    new, changed = names_for_arm(names, {})
    assert new == ("a_b_2", "a_b", "a_b_3", "J4_2", "J4", "e", "a_b_4")
    assert set(changed) == set(names) - {"a_b", "J4"}
    same, _ = names_for_arm(["x y", "x y"], {})
    assert same == ("x_y", "x_y")  # which the arm file refuses


def test_values_that_cannot_be_meant_are_asked_about(made):
    text = ROBOT.replace('"0.4 0 0"', '"400 0 0"').replace("0.1 0.2 0.3", "90 0 0")
    output, _ = made(text, "--hold-mm", "rail=0", "--base-posture-rad", "0,30,0")
    assert "line 6: rpy = '90 0 0' is more than a turn in radians: degrees?" in output
    assert "reach 400.3 m: were millimetres taken for metres?" in output
    assert (
        "a reading of --base-posture-rad is 30, more than a turn in radians" in output
    )
    output, _ = made(ROBOT, "--hold-mm", "rail=0")
    assert "?" not in output
