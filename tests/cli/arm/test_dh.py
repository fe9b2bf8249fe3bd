import json
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm

UR10_CSV = """\
# Nominal, metres
name, d_m, a_m, alpha_rad, theta_deg
shoulder_pan, 0.1273, 0, pi/2, 0
shoulder_lift, 0, -0.612, 0, 0
elbow, 0, -0.5723, 0, 0

wrist_1, 0.163941, 0, pi/2, 0
wrist_2, 0.1157, 0, -pi/2, 0
wrist_3, 0.0922, 0, 0, 0
"""
BENCH_TOML = """\
schema = "traverse/dh/1"
convention = "modified"
name = "bench"

[base]
xyz_mm = [10, 20, 30]

[tool]
xyz_mm = [0, 0, 80.0]
rpy_rad = [0.2, 0.1, 0.0]

[[rows]]
a_mm = 0
d_mm = 250.0
alpha_rad = 0
base_rad = 0.5
counts_per_turn = 1000
sign = -1
source = "head/4"

[[rows]]
name = "hinge"
a_m = 0.05
d_mm = 1.0
alpha_deg = 90.0
theta_deg = -30.0
"""


def traverse(*words, status=0):
    return invoke("arm", *words, status=status)


@pytest.fixture
def ur10(tmp_path: Path) -> Path:
    table = tmp_path / "ur10.csv"
    table.write_text(UR10_CSV, "utf-8")
    out = tmp_path / "ur10.toml"
    traverse("from-dh", table, "-o", out, "--convention", "classic")
    return out


def poses(path, readings_rad):
    return probe_pose(geometry_from_arm(read_arm(path)), readings_rad)


def readings(seed, n_joints):
    return np.random.default_rng(seed).uniform(-3, 3, (50, n_joints))


def test_a_csv_in_metres_becomes_an_arm_in_millimetres(ur10):
    arm = read_arm(ur10)
    assert [joint.name for joint in arm.joints][:2] == ["shoulder_pan", "shoulder_lift"]
    assert arm.joints[0].link_mm == (0.0, 0.0, 127.3)
    assert arm.joints[1].axis == (0.0, -1.0, 0.0)
    assert arm.joints[0].encoder is None
    centre_mm, _ = poses(ur10, np.zeros((1, 6)))
    np.testing.assert_allclose(centre_mm, [[-1184.3, -256.141, 11.6]], atol=1e-9)


def test_encoders_tool_and_base_posture_come_from_options(tmp_path, ur10):
    out = tmp_path / "other.toml"
    traverse(
        *("from-dh", tmp_path / "ur10.csv", "-o", out, "--convention", "classic"),
        *("--counts-per-turn", "4096", "--signs", "1,1,1,-1,1,1"),
        *("--base-posture-deg", "0,-90,90,0,90,0", "--device", "robot"),
        *("--tool-xyz-mm", "0,0,120", "--radius-mm", "1.5", "--switching"),
    )
    arm = read_arm(out)
    assert [joint.encoder.sign for joint in arm.joints] == [1, 1, 1, -1, 1, 1]
    assert arm.joints[3].encoder.source == "robot/3"
    assert arm.joints[1].zero_rad == -math.pi / 2
    assert (arm.probe.radius_mm, arm.probe.kind) == (1.5, "switching")
    plain_mm, shanks = poses(ur10, readings(1, 6))
    with_tool_mm, same_shanks = poses(out, readings(1, 6))
    np.testing.assert_allclose(with_tool_mm, plain_mm + 120.0 * shanks, atol=1e-9)
    np.testing.assert_allclose(same_shanks, shanks, atol=1e-12)


def test_a_toml_table_says_everything_by_itself(tmp_path):
    table, out = tmp_path / "bench.toml", tmp_path / "arm.toml"
    table.write_text(BENCH_TOML, "utf-8")
    traverse("from-dh", table, "-o", out)
    arm = read_arm(out)
    assert arm.name == "bench"
    assert [joint.name for joint in arm.joints] == ["J1", "hinge"]
    assert [joint.zero_rad for joint in arm.joints] == [0.5, 0.0]
    assert arm.joints[0].encoder.source == "head/4"
    assert arm.joints[0].encoder.sign == -1
    assert arm.joints[1].encoder is None
    # Craig's rows: the second hinge is 50 mm along x and lies along -y, at 0.5 rad.
    s, c = math.sin(0.5), math.cos(0.5)
    np.testing.assert_allclose(arm.joints[1].axis, [s, -c, 0.0], atol=1e-14)
    np.testing.assert_allclose(
        arm.joints[0].link_mm, [50.0 * c, 50.0 * s, 250.0], atol=1e-11
    )
    assert arm.origin_mm == (10.0, 20.0, 30.0)


@pytest.mark.parametrize("ending", ["csv", "toml"])
def test_an_arm_goes_to_a_table_and_back(tmp_path, ending):
    table, arm = tmp_path / "bench.toml", tmp_path / "arm.toml"
    back, repeated = tmp_path / f"back.{ending}", tmp_path / "again.toml"
    table.write_text(BENCH_TOML, "utf-8")
    traverse("from-dh", table, "-o", arm)
    written = traverse("to-dh", arm, "-o", back)
    assert "misfit at the probe over 1000 random postures" in written.output
    options = []
    if ending == "csv":
        # Options without a CSV column are stored in a comment, as typed.
        comment = [
            line for line in back.read_text("utf-8").splitlines() if "--" in line
        ]
        options = " ".join(comment).replace("#", "").replace("\\", "").split()
    traverse("from-dh", back, "-o", repeated, *options)
    before_mm, shanks = poses(arm, readings(2, 2))
    after_mm, shanks_after = poses(repeated, readings(2, 2))
    np.testing.assert_allclose(after_mm, before_mm, rtol=0, atol=1e-9)
    np.testing.assert_allclose(shanks_after, shanks, rtol=0, atol=1e-11)
    zeros_rad = [joint.zero_rad for joint in read_arm(repeated).joints]
    assert zeros_rad == [0.5, 0.0]


def test_to_dh_reports_as_json_what_it_takes_as_parallel(ur10):
    report = json.loads(traverse("to-dh", ur10, "--json").stdout)
    rows = report["table"]["rows"]
    assert [row["a_mm"] for row in rows] == [0.0, -612.0, -572.3, 0.0, 0.0, 0.0]
    assert [row["d_mm"] for row in rows] == [127.3, 0.0, 0.0, 163.941, 115.7, 92.2]
    assert report["misfit_mm"]["max"] < 1e-9
    parallel = [pair["joints"] for pair in report["pairs"] if pair["parallel"]]
    assert parallel == [["shoulder_lift", "elbow"], ["elbow", "wrist_1"]]


def test_to_dh_warns_of_hinges_that_are_nearly_parallel(tmp_path, ur10):
    text = ur10.read_text("utf-8")
    tilted = text.replace(
        'name = "elbow"\naxis = [0.0, -1.0, 0.0]',
        'name = "elbow"\naxis = [0.0001, -1.0, 0.0]',
    )
    assert tilted != text
    ur10.write_text(tilted, "utf-8")
    output = traverse("to-dh", ur10).stdout
    assert "# shoulder_lift and elbow are 0.0001 rad apart: 1e-05 rad of tilt" in output
    json_text = traverse(
        "to-dh", ur10, "--parallel-below-rad", "0.001", "--json"
    ).stdout
    report = json.loads(json_text)
    assert report["pairs"][1]["parallel"]
    assert 0.001 < report["misfit_mm"]["max"] < 0.5


def refused(tmp_path, name, text, *options):
    table, out = tmp_path / name, tmp_path / "arm.toml"
    table.write_text(text, "utf-8")
    ended = traverse("from-dh", table, "-o", out, *options, status=2)
    assert not out.exists()
    return ended.output.replace(str(table), "FILE")


def test_units_that_cannot_be_meant_are_asked_about(tmp_path):
    table, out = tmp_path / "t.csv", tmp_path / "arm.toml"
    made = ("from-dh", table, "-o", out, "--convention", "classic", "--force")
    table.write_text(
        "name,d_mm,a_mm,alpha_rad,theta_rad\nJ1,400,25,-90,0\nJ2,0,455,0,7\n"
    )
    output = traverse(*made).output
    assert (
        "alpha_rad of J1 is -90, more than a turn in radians: degrees? -90 degr"
        in output
    )
    assert "theta_rad of J2 is 7, more than a turn" in output
    table.write_text("d_m,a_m,alpha_deg\n400,25,-90\n0,455,0\n")
    assert "reach 855.8 m: were millimetres taken for metres?" in traverse(*made).output
    table.write_text("d_mm,a_mm,alpha_deg\n0.4,0.025,-90\n0,0.455,0\n")
    assert "reach 0.856 mm: were metres taken" in traverse(*made).output
    table.write_text("d_mm,a_mm,alpha_deg\n400,25,-1.571\n0,455,0\n")
    printed = traverse(*made).output
    assert "alpha_deg of J1 is -1.571 degrees, a part of pi: radians?" in printed
    table.write_text("d_mm,a_mm,alpha_deg\n400,25,-900\n0,455,0\n0,90,1.57\n")
    assert "?" not in traverse(*made).output


def test_a_table_of_nearly_parallel_hinges_becomes_an_arm_of_its_size(tmp_path):
    table, out = tmp_path / "t.csv", tmp_path / "arm.toml"
    table.write_text(
        "d_mm,a_mm,alpha_rad\n127.3,0,1.5707963\n231000,-612,0.0005\n"
        "-231000.2,-572.3,-0.0005\n163.9,0,1.5707963\n115.7,0,-1.5707963\n92.2,0,0\n"
    )
    words = ("from-dh", table, "-o", out, "--convention", "classic")
    output = traverse(*words).output
    assert (
        "origins slid along hinges that are nearly parallel, which moves nothing"
        in output
    )
    shown = traverse("show", out).output
    reach_mm = float(shown.partition("reach ")[2].split()[0])
    assert 1400 < reach_mm < 2200
    # As a file may have it that was made otherwise.
    text = out.read_text("utf-8")
    start = text.index("link_mm", text.index('name = "J2"'))
    far = text[:start] + "link_mm = [0.0, 0.0, -231000.0]\n#" + text[start:]
    out.write_text(far, "utf-8")
    rows = traverse("show", out).output.splitlines()
    row = next(line for line in rows if line.startswith("J2 "))
    assert "231000.000" in row.split()


def test_all_mistakes_of_a_csv_are_said_at_once(tmp_path):
    text = (
        "name,a_mm,d,alpha_deg,a_m,tehta_deg,sign\n"
        "J1,1,2,90,1,0,1\n"
        "J2,1,2,90\n"
        "J3,,2,pi/2,1,0,2\n"
    )
    assert refused(tmp_path, "t.csv", text, "--convention", "classic") == (
        "FILE: 7 problems\n"
        "  line 1, column d: has no unit; name it 'd_mm' or 'd_m', or give --lengths "
        "mm or m\n"
        "  line 1, column a_m: says again what 'a_mm' says\n"
        "  line 1, column tehta_deg: unknown key 'tehta_deg'; did you mean "
        "'theta_deg'?\n"
        "  line 3: has 4 cells; the header has 7, with ',' between them\n"
        "  line 4, column a_mm: is empty; give a number\n"
        "  line 4, column alpha_deg: 'pi/2' is not a finite number of degrees: parts "
        "of pi are radians; write it like -1234.5, without unit\n"
        "  line 4, column sign: 2 is not 1 or -1\n"
    )


def test_all_mistakes_of_a_toml_table_are_said_at_once(tmp_path):
    text = (
        'schema = "traverse/dh/1"\nconvention = "modern"\ncolour = 1\n'
        '[[rows]]\na_mm = "1.0"\nd_mm = nan\n'
        "[[rows]]\na_mm = 1\nd_mm = 1\nalpha_rad = 0\ncounts_per_turn = 0\nname = 3\n"
    )
    message = refused(tmp_path, "t.toml", text)
    assert message.startswith("FILE: 7 problems\n")
    for where in (
        "convention: 'modern' is not valid here",
        "colour: unknown key",
        "rows[0].alpha_rad: is missing",
        "rows[0].a_mm: '1.0' is not a finite number\n",
        "rows[0].d_mm: nan is not a finite number",
        "rows[1].counts_per_turn: 0 is not an integer from 1 to 2^32",
        "rows[1].name: 3 is not a string",
    ):
        assert where in message


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        (UR10_CSV, [], "convention: is not given; use --convention classic or"),
        ("a_mm,d_mm,alpha_rad\n", ["--convention", "classic"], "holds no table"),
        (
            UR10_CSV.replace("elbow", "wrist_1"),
            ["--convention", "classic"],
            "joints[3].name: 'wrist_1' is also the name of joints[2]",
        ),
        (
            "a_mm,d_mm,alpha_rad,sign,name\n1,1,0,-1,A\n1,1,0,,B\n1,1,0,1,C\n",
            ["--convention", "classic"],
            "A, C: a sign or source, but no encoder; give counts per turn",
        ),
    ],
)
def test_a_table_without_an_answer_is_refused(tmp_path, text, options, expected):
    assert expected in refused(tmp_path, "t.csv", text, *options)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--base-posture-rad", "1,2"),
        ("--tool-xyz-mm", "1,2,nan"),
        ("--counts-per-turn", "1,2"),
        ("--signs", "+"),
    ],
)
def test_options_that_do_not_fit_the_table_are_refused(tmp_path, ur10, option, value):
    out = tmp_path / "other.toml"
    ended = traverse(
        *("from-dh", tmp_path / "ur10.csv", "-o", out, "--convention", "classic"),
        *(option, value),
        status=2,
    )
    assert f"'{value}' is not" in ended.output
    assert not out.exists()


def test_columns_without_units_take_those_of_the_options(tmp_path, ur10):
    bare = UR10_CSV.replace("_m,", ",").replace("_rad", "").replace("_deg", "")
    table, out = tmp_path / "bare.csv", tmp_path / "bare.toml"
    table.write_text("\ufeff" + bare.replace("\n", "\r\n"), "utf-8")
    units = ("--lengths", "m", "--angles", "rad")
    traverse("from-dh", table, "-o", out, "--convention", "classic", *units)
    assert read_arm(out).joints == read_arm(ur10).joints


@pytest.mark.parametrize(
    ("text", "value_rad"),
    [
        ("pi", math.pi),
        ("-pi/2", -math.pi / 2),
        ("2*pi/3", 2 * math.pi / 3),
        ("+0.5pi", math.pi / 2),
        ("-1.5e-3", -1.5e-3),
    ],
)
def test_angles_may_be_parts_of_pi(tmp_path, text, value_rad):
    table, out = tmp_path / "t.csv", tmp_path / "t.toml"
    table.write_text(f"a_mm,d_mm,alpha_rad\n1,0,{text}\n0,1,0\n", "utf-8")
    traverse("from-dh", table, "-o", out, "--convention=classic")
    expected = [0.0, -math.sin(value_rad), math.cos(value_rad)]
    np.testing.assert_allclose(read_arm(out).joints[1].axis, expected, atol=1e-14)


PIECES = [
    "1e308",
    "pi",
    "a_mm",
    ",",
    '"',
    "[[rows]]",
    "\n",
    "-",
    "nan",
    "0x1",
    "J1",
    "=",
]


@settings(max_examples=15)
@given(st.sampled_from([("csv", UR10_CSV), ("toml", BENCH_TOML)]), st.data())
def test_a_damaged_table_is_made_an_arm_or_refused_and_nothing_else(kind, data):
    ending, text = kind
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        stop = start + data.draw(st.integers(0, 20))
        new = data.draw(st.text(max_size=4) | st.sampled_from(PIECES))
        text = text[:start] + new + text[stop:]
    with tempfile.TemporaryDirectory() as folder:
        table, out = Path(folder) / f"t.{ending}", Path(folder) / "arm.toml"
        table.write_bytes(text.encode("utf-8", "surrogatepass"))
        options = ["--convention", "classic"] if ending == "csv" else []
        ended = traverse("from-dh", table, "-o", out, *options, status=None)
        assert ended.exit_code in (0, 2), ended.exception
        assert out.exists() == (ended.exit_code == 0)
