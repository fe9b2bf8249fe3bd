"""Campaigns of other people's tables, against an arm multiplied out here."""

import json
import struct

import numpy as np
import pytest
import scipy.io
from mcap.writer import Writer

from tests.kinematics.importers.matrices import rotation
from tests.running import invoke
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.lab.campaign.campaign import read_campaign

ARM = """\
schema = "traverse/arm/1"
name = "two"
origin_mm = [0, 0, 100]
[[joints]]
name = "J1"
axis = [0, 0, 1]
link_mm = [0, 0, 200]
zero_rad = 0.0
[[joints]]
name = "J2"
axis = [0, 1, 0]
link_mm = [400, 0, 0]
zero_rad = 0.0
[[joints]]
name = "J3"
axis = [0, 1, 0]
link_mm = [250, 0, 0]
zero_rad = 0.0
[probe]
radius_mm = 0.0
kind = "hard"
vector_mm = [0, 0, 50]
direction = [0, 0, 1]
"""


def ball_mm(j1, j2, j3):
    def turn(axis, angle):
        return rotation(axis, angle)[:3, :3]

    behind_2 = np.array([400, 0, 0]) + turn([0, 1, 0], j3) @ [250, 0, 50]
    above_mm = np.array([0, 0, 300])
    return above_mm + turn([0, 0, 1], j1) @ turn([0, 1, 0], j2) @ behind_2


ANGLES_RAD = np.random.default_rng(3).uniform(-1.5, 1.5, (24, 3))
TURNED = rotation(np.array([0.6, 0.0, 0.8]), 0.7)[:3, :3]
SHIFT_MM = np.array([10, 2000, -5])
TARGETS_MM = SHIFT_MM + np.array([TURNED @ ball_mm(*row) for row in ANGLES_RAD])


@pytest.fixture
def made(tmp_path):
    arm = tmp_path / "arm.toml"
    arm.write_text(ARM)

    def make(name, *options, status=0):
        words = ("campaign", "from-table", tmp_path / name, "--arm", arm, "--force")
        return invoke(*words, "-o", tmp_path / "out", "--json", *options, status=status)

    return make


def assert_campaign(folder, ran, n=24, **expected):
    names = [joint.name for joint in parse_arm(ARM).joints]
    campaign = read_campaign(folder / "out", names, orientations=True)
    np.testing.assert_allclose(campaign.poses.angles_rad, ANGLES_RAD[:n], atol=1e-9)
    (artefact,) = campaign.artefacts
    places = np.array(list(artefact.points_mm.values()))
    np.testing.assert_allclose(places, TARGETS_MM[:n], atol=1e-6)
    report = json.loads(ran.stdout)
    assert report["rms_mm"] < 1e-4
    assert expected.items() <= report.items()
    return campaign


def write(path, header, *columns, separator=",", decimal="."):
    rows = zip(*(np.atleast_2d(np.transpose(c)).T for c in columns), strict=True)
    lines = [separator.join(header)] if header else []
    for row in rows:
        cells = [repr(float(value)) for part in row for value in np.ravel(part)]
        lines.append(separator.join(cells).replace(".", decimal))
    path.write_text("\n".join(lines) + "\n", "utf-8")


DEG = 180 / np.pi
ROBODK = ["J1 (deg)", "J2 (deg)", "J3 (deg)", "X (mm)", "Y (mm)", "Z (mm)"]
LAYOUTS = {
    "named": (["J1_rad", "J2_rad", "J3_rad", "x_mm", "y_mm", "z_mm"], 1, 1),
    "no units": (["J1", "J2", "J3", "X", "Y", "Z"], DEG, 1),
    "RoboDK": (ROBODK, DEG, 1),
    "from 0, metres": (["q0", "q1", "q2", "target_x", "target_y", "target_z"], 1, 1e-3),
    "inches": (["Joint 1", "Joint 2", "Joint 3", "x", "y", "z"], 1, 1 / 25.4),
    "other names": (["a", "b", "c", "u", "v", "w"], 1, 1),
    "no header": (None, DEG, 1),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_columns_and_units_are_guessed(made, tmp_path, layout):
    header, angle, length = LAYOUTS[layout]
    write(tmp_path / "t.csv", header, angle * ANGLES_RAD, length * TARGETS_MM)
    options = ("--joints", "a,b,c", "--position", "u,v,w")
    ran = made("t.csv", "--yes", *(options if layout == "other names" else ()))
    units = {1: "rad", DEG: "deg"}[angle], {1: "mm", 1e-3: "m"}.get(length, "inch")
    assert_campaign(tmp_path, ran, angles=units[0], lengths=units[1])


def test_decimal_commas_times_temperatures_names_and_quaternions(made, tmp_path):
    n = 5
    header = [
        "timestamp_ms",
        "q1",
        "q2",
        "q3",
        "px",
        "py",
        "pz",
        "qw",
        "qx",
        "qy",
        "qz",
    ]
    extra = ["temperature_c", "vx", "vy", "vz"]
    times = 1000.0 * np.arange(n)
    quaternions = np.tile([0.5, 0.5, -0.5, 0.5], (n, 1))
    turns = np.column_stack([np.full(n, 20.5), np.zeros((n, 3))])
    columns = (times, ANGLES_RAD[:n], TARGETS_MM[:n], quaternions, turns)
    write(tmp_path / "t.csv", header + extra, *columns, separator=";", decimal=",")
    ran = made("t.csv", "--yes", "--angles", "rad")
    campaign = assert_campaign(tmp_path, ran, n, time="timestamp_ms")
    assert campaign.poses.time_s.tolist() == [0, 1, 2, 3, 4]
    assert campaign.poses.temperature_c.tolist() == [20.5] * n
    assert campaign.poses.orientations[0].tolist() == [0.5, 0.5, -0.5, 0.5]
    assert json.loads(ran.stdout)["left_out"] == ["vx", "vy", "vz"]


def test_a_file_of_matlab_is_read(made, tmp_path):
    variables = {"q": np.degrees(ANGLES_RAD), "p": TARGETS_MM.T / 1000, "note": "text"}
    scipy.io.savemat(tmp_path / "t.mat", variables)
    ran = made("t.mat", "--yes")
    assert_campaign(tmp_path, ran, angles="deg", lengths="m")
    scipy.io.savemat(tmp_path / "t.mat", {"q": ANGLES_RAD, "p": TARGETS_MM[:5]})
    assert "of one number of rows" in made("t.mat", "--yes", status=2).stderr
    (tmp_path / "t.mat").write_bytes(b"MATLAB 5.0 nothing")
    assert "is no .mat file" in made("t.mat", "--yes", status=2).stderr


def cdr_time(stamp_s):
    seconds = int(stamp_s)
    return struct.pack("<iI", seconds, round(1e9 * (stamp_s - seconds)))


class Cdr:
    """Little-endian CDR by hand, as the specification of OMG aligns it."""

    def __init__(self):
        self.body = b""

    def align(self, size):
        self.body += b"\0" * (-len(self.body) % size)

    def header(self, stamp_s):
        self.body += cdr_time(stamp_s)
        self.text("base")
        return self

    def text(self, text):
        self.align(4)
        self.body += struct.pack("<I", len(text) + 1) + text.encode() + b"\0"

    def doubles(self, numbers, *, counted):
        if counted:
            self.align(4)
            self.body += struct.pack("<I", len(numbers))
        if len(numbers):
            self.align(8)
            self.body += struct.pack(f"<{len(numbers)}d", *numbers)

    def message(self):
        return b"\0\1\0\0" + self.body


HEADER = "\n{0}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
HEADER += "{0}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER = HEADER.format("=" * 80)
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
JOINT_STATE += "float64[] velocity\nfloat64[] effort" + HEADER
POINT = "std_msgs/Header header\ngeometry_msgs/Point point" + HEADER + "=" * 80
POINT += "\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"


def write_bag(path, targets_m):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        channels = {}
        for topic, kind, text in (
            ("/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE),
            ("/tracker", "geometry_msgs/msg/PointStamped", POINT),
        ):
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for index, (angles, target) in enumerate(
            zip(ANGLES_RAD, targets_m, strict=True)
        ):
            # The arm rests from 0.1 s before to 0.1 s after each target.
            for later_s in (-0.1, 0.1):
                state = Cdr().header(1e9 + index + later_s)
                state.align(4)
                state.body += struct.pack("<I", 3)
                for name in ("J1", "J2", "J3"):
                    state.text(name)
                state.doubles(angles, counted=True)
                state.doubles([], counted=True)
                state.doubles([], counted=True)
                add(writer, channels["/joint_states"], state)
            point = Cdr().header(1e9 + index)
            point.doubles(target, counted=False)
            add(writer, channels["/tracker"], point)
        writer.finish()


def add(writer, channel, cdr):
    writer.add_message(channel, log_time=0, data=cdr.message(), publish_time=0)


def test_a_bag_of_ros_is_read(made, tmp_path):
    pytest.importorskip("mcap_ros2", reason="the extra ros is not installed")
    write_bag(tmp_path / "t.mcap", TARGETS_MM / 1000)
    ran = made("t.mcap", "--yes")
    assert_campaign(tmp_path, ran, angles="rad", lengths="m", time="time_s")
    (tmp_path / "t.mcap").write_bytes(b"\x89MCAP0\r\n")
    assert "is no bag of ROS 2 in MCAP" in made("t.mcap", "--yes", status=2).stderr


def test_it_asks_and_writes_nothing_without_an_answer(made, tmp_path):
    header = ["J1_rad", "J2_rad", "J3_rad", "x_mm", "y_mm", "z_mm"]
    write(tmp_path / "t.csv", header, ANGLES_RAD, TARGETS_MM)
    message = made("t.csv", status=2).stderr
    assert "joints      J1: J1_rad, J2: J2_rad, J3: J3_rad [rad]" in message
    assert "nobody can be asked; give --yes if this is right" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("header", "options", "message"),
    [
        (
            ["a", "b", "c", "x", "y", "z"],
            (),
            "no columns for the joints J1, J2, J3; say",
        ),
        (
            ["q1", "q2", "q3", "a", "b", "c"],
            (),
            "no columns for x, y, z of the targets",
        ),
        (
            ["q1", "q2", "q3", "rx", "ry", "rz"],
            ("--position", "x,y,z"),
            "--position: no column 'x'; there are: q1, q2",
        ),
        (["q1", "q2", "q3", "x", "y", "z"], ("--joints", "q1"), "--joints names 1 col"),
        (["q1", "q2", "q3", "x_m", "y_m", "z_mm"], (), "have different units"),
        (["q1", "q2", "q3", "x", "y", "z"], ("--angles", "gon"), "expected rad or deg"),
    ],
)
def test_what_stays_open_is_refused(made, tmp_path, header, options, message):
    write(tmp_path / "t.csv", header, ANGLES_RAD, TARGETS_MM)
    assert message in made("t.csv", "--yes", *options, status=2).stderr


def test_another_arm_is_told(made, tmp_path):
    header = ["J1_rad", "J2_rad", "J3_rad", "x_mm", "y_mm", "z_mm"]
    write(tmp_path / "t.csv", header, ANGLES_RAD[::-1], TARGETS_MM)
    message = made("t.csv", status=2).stderr
    assert "that is far: mind the units, signs and zeros of the readings" in message
