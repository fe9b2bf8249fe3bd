"""Campaign folders: read whole or refused with every line that is wrong."""

import numpy as np
import pytest

from traverse.lab.campaign.campaign import read_campaign
from traverse.strict_toml.problems import FileError

CAMPAIGN = """\
schema = "traverse/campaign/1"
poses = "poses.csv"
start_utc = 2026-11-20T09:00:00Z
gravity_m_s2 = [0.1, 0.0, -9.8]
[noise]
encoder_rad = 4e-6
[[artefacts]]
id = "cone-1"
kind = "cone"
[[artefacts]]
id = "bar"
kind = "ball_bar"
radius_mm = 12.7
distance_mm = 800.0
expansion_per_c = 1e-5
[[artefacts]]
id = "grid"
kind = "points"
frame = "own"
points_mm = "grid.csv"
"""
GRID = "feature,x_mm,y_mm,z_mm\nA,0,0,0\nB,100,0,0\nC,0,100,0\n"
HEADER = (
    "time_s,artefact,feature,J1_rad,J2_rad,temperature_c,J1_approach,"
    "direction_x,direction_y,direction_z\n"
)
ROWS = """\
0.5,cone-1,,0.1,0.2,21.5,-1,,,
1.5,bar,2,0.3,0.4,,0,0,0,-1
2.5,grid,C,0.5,0.6,22,1,1,0,0
3.5,grid,A,-0.5,6e-1,22,,1,0,0
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "grid.csv").write_text(GRID)
    (tmp_path / "poses.csv").write_text(HEADER + ROWS)
    return tmp_path


def problems(folder):
    with pytest.raises(FileError) as caught:
        read_campaign(folder, ["J1", "J2"])
    return [str(problem) for problem in caught.value.problems]


def test_a_campaign_is_read_into_arrays(folder):
    campaign = read_campaign(folder, ["J1", "J2"])
    poses = campaign.poses
    assert [artefact.id for artefact in campaign.artefacts] == ["cone-1", "bar", "grid"]
    assert campaign.encoder_rad == 4e-6
    assert campaign.contact_mm is None
    assert campaign.gravity_m_s2 == (0.1, 0.0, -9.8)
    assert poses.lines.tolist() == [2, 3, 4, 5]
    assert poses.time_s.tolist() == [0.5, 1.5, 2.5, 3.5]
    assert poses.artefacts.tolist() == [0, 1, 2, 2]
    assert poses.angles_rad.tolist() == [
        [0.1, 0.2],
        [0.3, 0.4],
        [0.5, 0.6],
        [-0.5, 0.6],
    ]
    assert poses.temperature_c == pytest.approx([21.5, np.nan, 22, 22], nan_ok=True)
    assert poses.approaches[:, 0] == pytest.approx([-1, 0, 1, np.nan], nan_ok=True)
    assert np.all(np.isnan(poses.approaches[:, 1]))
    assert poses.directions[1].tolist() == [0, 0, -1]
    assert poses.speeds_rad_s is None
    assert len(campaign.digest) == 64


WIRE = """\
[[artefacts]]
id = "wire"
kind = "draw_wire"
"""


def test_the_length_of_a_wire_is_read_where_it_belongs(folder):
    (folder / "campaign.toml").write_text(CAMPAIGN + WIRE)
    header = HEADER.replace("\n", ",length_mm\n")
    rows = ROWS.replace("\n", ",\n") + "9,wire,,0.1,0.3,,,,,,212.5\n"
    (folder / "poses.csv").write_text(header + rows)
    campaign = read_campaign(folder, ["J1", "J2"])
    lengths_mm = campaign.touches(3, np.array([4]), 3.0).known_lengths_mm
    assert lengths_mm.tolist() == [212.5]
    rows += "10,wire,,0.2,0.3,,,,,,\n11,cone-1,,0.1,0.3,,,,,,7\n"
    (folder / "poses.csv").write_text(header + rows)
    assert problems(folder) == [
        "line 7: length_mm is missing; 'wire' reads a length at every pose",
        "line 8: length_mm does not belong to 'cone-1'; leave it empty",
    ]
    (folder / "poses.csv").write_text(HEADER + "9,wire,,0.1,0.3,,,,,\n")
    assert "length_mm is missing" in problems(folder)[0]


def test_points_that_were_not_touched_are_left_out(folder):
    campaign = read_campaign(folder, ["J1", "J2"])
    assert campaign.feature_names[2] == ("A", "C")
    assert campaign.poses.features.tolist()[2:] == [1, 0]
    assert campaign.artefacts[2].points_mm == {"A": (0, 0, 0), "C": (0, 100, 0)}


def test_columns_may_stand_in_any_order(folder):
    (folder / "poses.csv").write_text(
        "J2_rad,feature,artefact,J1_rad,time_s\n0.2,,cone-1,0.1,7\n"
    )
    poses = read_campaign(folder, ["J1", "J2"]).poses
    assert poses.angles_rad.tolist() == [[0.1, 0.2]]
    assert poses.time_s.tolist() == [7.0]


def test_the_temperature_stretches_the_artefact(folder):
    campaign = read_campaign(folder, ["J1", "J2"])
    rows = np.array([1])
    assert campaign.touches(1, rows, 3.0).growths.tolist() == [0.0]
    poses = campaign.poses
    poses.temperature_c[1] = 23.0
    assert campaign.touches(1, rows, 3.0).growths == pytest.approx([3e-5])


def test_every_bad_row_is_reported_with_its_line(folder):
    bad = """\
x,cone-1,,0.1,0.2,21.5,-1,,,
1.5,bar,3,0.3,inf,,0,0,0,-1
2.5,gird,C,0.5
2.5,gird,C,0.5,0.6,22,1,1,0,0

3.5,grid,D,0.5,1_0,22,2,1,1,0
4.5,cone-1,,0.1,0.2,warm,-1,1,,
5.5,cone-1,,0.1,0.2,20,-1,1,0,0
"""
    (folder / "poses.csv").write_text(HEADER + bad)
    lines = problems(folder)
    expected = [
        ("line 2", "time_s: 'x' is not"),
        ("line 3", "unknown feature '3'"),
        ("line 3", "J2_rad: 'inf' is not"),
        ("line 4", "has 4 cells; the header has 10"),
        ("line 5", "unknown artefact 'gird'; did you mean 'grid'?"),
        ("line 7", "unknown feature 'D'"),
        ("line 7", "J2_rad: '1_0' is not"),
        ("line 7", "J1_approach: is '2'"),
        ("line 7", "direction has the length 1.414"),
        ("line 8", "temperature_c: 'warm' is not"),
        ("line 8", "give all three components or none"),
    ]
    assert len(lines) == len(expected)
    for text, (where, message) in zip(lines, expected, strict=True):
        assert text.startswith(where)
        assert message in text


def test_a_bad_row_far_down_is_found(folder):
    row = "0.5,cone-1,,0.1,0.2,21.5,-1,,,\n"
    rows = [row] * 45_000
    rows[44_000] = row.replace("0.2", "")
    (folder / "poses.csv").write_text(HEADER + "".join(rows))
    assert problems(folder) == ["line 44002, column J2_rad: is empty; give a number"]


def test_many_bad_rows_are_counted_not_listed(folder):
    (folder / "poses.csv").write_text(HEADER + "x\n" * 5000)
    lines = problems(folder)
    assert len(lines) == 101
    assert lines[-1] == "and 4900 more problems like these"


def test_all_mistakes_of_a_header_are_reported(folder):
    (folder / "poses.csv").write_text(
        "time,artefact,feature,J1_rad,J1_rad,J3_rad,direction_x\n"
    )
    text = "\n".join(problems(folder))
    assert "column 'time_s' is missing" in text
    assert "column 'J2_rad' is missing" in text
    assert "unknown column 'time'; did you mean 'time_s'?" in text
    assert "column 'J1_rad' stands there twice" in text
    assert "unknown column 'J3_rad'" in text
    assert "direction_x needs direction_y, direction_z beside it" in text


@pytest.mark.parametrize(
    ("old", "new", "where", "message"),
    [
        ('kind = "cone"', 'kind = "kone"', "artefacts[0].kind", "did you mean 'cone'?"),
        ('id = "bar"', 'id = "cone-1"', "artefacts[1].id", "ids must differ"),
        ("distance_mm", "distance", "artefacts[1].distance", "'distance_mm'"),
        ("radius_mm = 12.7", "radius_mm = -1", "artefacts[1].radius_mm", "too small"),
        ('frame = "own"', 'frame = "mine"', "artefacts[2].frame", "'own_scaled'"),
        ("encoder_rad = 4e-6", "encoder = 4e-6", "noise.encoder", "encoder_rad"),
        ("radius_mm = 12.7", "radius_mm = nan", "artefacts[1].radius_mm", "finite"),
        ("start_utc", 'time = "order"\nstart_utc', "start_utc", "remove one of them"),
        ("start_utc", 'time = "rows"\nstart_utc', "time", "'order'"),
    ],
)
def test_mistakes_of_the_campaign_file_are_named(folder, old, new, where, message):
    (folder / "campaign.toml").write_text(CAMPAIGN.replace(old, new))
    lines = problems(folder)
    assert any(text.startswith(f"{where}: ") and message in text for text in lines)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ("name,x,y,z\nA,0,0,0\n", "line 1: columns are"),
        (GRID + "A,1,2,3\n", "line 5: 'A' was given before"),
        (GRID + "D,1,2\n", "line 5: has 3 cells; the header has 4"),
        (GRID + "D,1,2,nan\n", "line 5, column z_mm: 'nan' is not a finite number"),
        ("feature,x_mm,y_mm,z_mm\n", "holds no points"),
    ],
)
def test_mistakes_of_a_list_of_points_are_named(folder, grid, message):
    (folder / "grid.csv").write_text(grid)
    assert any(message in text for text in problems(folder))


@pytest.mark.parametrize("name", ["campaign.toml", "poses.csv", "grid.csv"])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    # No poses yet is how every campaign begins.
    expected = (
        "no poses yet" if name == "poses.csv" else rf"{name}: 1 problem\n.*cannot be"
    )
    with pytest.raises(FileError, match=expected):
        read_campaign(folder, ["J1", "J2"])


def test_times_may_be_an_order(folder):
    assert not read_campaign(folder, ["J1", "J2"]).time_is_order
    text = CAMPAIGN.replace("start_utc = 2026-11-20T09:00:00Z", 'time = "order"')
    (folder / "campaign.toml").write_text(text)
    assert read_campaign(folder, ["J1", "J2"]).time_is_order


TOOLS = '[[tools]]\nname = "low"\n[[tools]]\nname = "high"\nheld = true\n'


def with_tools(folder, tools, *names):
    """Name tools in the first poses."""
    lines = (HEADER + ROWS).splitlines()
    cells = ["tool", *names, *[""] * (len(lines) - 1 - len(names))]
    table = "".join(f"{a},{b}\n" for a, b in zip(lines, cells, strict=True))
    (folder / "poses.csv").write_text(table)
    (folder / "campaign.toml").write_text(CAMPAIGN + tools)


def test_poses_name_tools_where_that_is_requested(folder):
    with_tools(folder, TOOLS, "high", "", "low")
    assert (
        "only `traverse identify`, `diagnose`, `predict` and `verify`"
        in problems(folder)[0]
    )
    campaign = read_campaign(folder, ["J1", "J2"], several_tools=True)
    assert campaign.poses.tools.tolist() == [2, 0, 1, 0]
    assert [tool.name for tool in campaign.tools] == ["low", "high"]
    assert campaign.part(campaign.poses.tools > 0).poses.tools.tolist() == [2, 1]
    with_tools(folder, TOOLS)
    assert read_campaign(folder, ["J1", "J2"]).poses.tools is None


@pytest.mark.parametrize(
    ("tools", "names", "message"),
    [
        (TOOLS, ["hihg"], "unknown tool 'hihg'; did you mean 'high'?; say it in [[too"),
        ("", ["high"], "unknown tool 'high'; known here: ; say it in [[tools]]"),
        (TOOLS + TOOLS, [], "tools[2].name: 'low' is also the name of tools[0]"),
        (TOOLS.replace("low", "l.w"), [], "tools[0].name: 'l.w' is not a tool's name"),
    ],
)
def test_mistakes_about_tools_are_named(folder, tools, names, message):
    with_tools(folder, tools, *names)
    assert any(message in text for text in problems(folder))


def test_the_same_readings_with_another_tool_are_no_copy(folder):
    with_tools(folder, TOOLS, "", "", "low", "high")
    text = (
        (folder / "poses.csv").read_text().replace("grid,A,-0.5,6e-1", "grid,C,0.5,0.6")
    )
    (folder / "poses.csv").write_text(text)
    assert read_campaign(folder, ["J1", "J2"], several_tools=True).notes == ()


def test_no_poses_are_refused(folder):
    (folder / "poses.csv").write_text(HEADER)
    assert problems(folder) == ["holds no poses; measure some"]


def test_bytes_that_are_not_utf_8_are_refused(folder):
    (folder / "poses.csv").write_bytes(HEADER.encode() + b"\xff\xfe\n")
    assert "line 2, column 1: byte 0xff (in Windows-1252 U+00FF" in problems(folder)[0]


def test_a_part_of_a_campaign_keeps_its_artefacts(folder):
    campaign = read_campaign(folder, ["J1", "J2"])
    part = campaign.part(campaign.poses.artefacts == 2)
    assert len(part.poses) == 2
    assert part.poses.lines.tolist() == [4, 5]
    assert part.artefacts == campaign.artefacts


def written_with(text, mark, decimal):
    """The same table as another program would write it."""
    return text.replace(",", mark).replace(".", decimal)


@pytest.mark.parametrize(("mark", "decimal"), [(";", "."), (";", ","), ("\t", ",")])
def test_other_separators_and_decimal_commas_are_read(folder, mark, decimal):
    expected = read_campaign(folder, ["J1", "J2"])
    for name in ("poses.csv", "grid.csv"):
        text = (folder / name).read_text()
        (folder / name).write_text(written_with(text, mark, decimal))
    campaign = read_campaign(folder, ["J1", "J2"])
    assert np.array_equal(campaign.poses.angles_rad, expected.poses.angles_rad)
    assert np.array_equal(campaign.poses.time_s, expected.poses.time_s)
    assert campaign.artefacts == expected.artefacts


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        (
            HEADER.replace(",", ";"),
            "0.5;cone-1;;0,1;0.2;21.5;-1;;;\n",
            "has decimal commas ('0,1' in line 2) and decimal points ('0.5' in line 2)",
        ),
        (
            HEADER.replace(",", ";"),
            "1.000,5;cone-1;;0.1;0,2;21,5;-1;;;\n",
            "none between thousands",
        ),
        (
            HEADER.replace(",", ";"),
            "1,000,5;cone-1;;0,1;0,2;21,5;-1;;;\n",
            "time_s: '1,000,5' is not a finite number",
        ),
        (
            HEADER,
            "0,5,cone-1,,0,1,0,2,21,5,-1,,,\n",
            "decimal commas need ';' or tabs between the columns",
        ),
        (
            HEADER.replace(",", ";", 1),
            "\n",
            "line 1: has ',' and ';' between its columns; use one of them",
        ),
    ],
)
def test_ambiguous_separators_are_named(folder, header, row, message):
    (folder / "poses.csv").write_text(header + row)
    assert any(message in text for text in problems(folder))


def test_a_copied_line_counts_once_and_is_reported(folder):
    rows = ROWS.splitlines(keepends=True)
    (folder / "poses.csv").write_text(HEADER + "".join([*rows, rows[0], rows[2]]))
    campaign = read_campaign(folder, ["J1", "J2"])
    assert campaign.poses.lines.tolist() == [2, 3, 4, 5]
    assert campaign.notes == (
        "poses.csv: copies of other poses, which count once: lines 6 (as 2), 7 (as 4)",
    )


def test_a_copy_under_another_name_of_the_same_point_counts_once(folder):
    (folder / "grid.csv").write_text(GRID + "E,0,100,0\n")
    copy = ROWS.splitlines()[2].replace("2.5", "9").replace(",C,", ",E,")
    (folder / "poses.csv").write_text(HEADER + ROWS + copy + "\n")
    campaign = read_campaign(folder, ["J1", "J2"])
    assert campaign.poses.lines.tolist() == [2, 3, 4, 5]
    assert campaign.feature_names[2] == ("A", "C")
    assert "lines 6 (as 4)" in campaign.notes[0]


def test_equal_readings_at_another_time_count_and_are_reported(folder):
    again = ROWS.splitlines()[1].replace("1.5", "9")
    (folder / "poses.csv").write_text(HEADER + ROWS + again + "\n")
    campaign = read_campaign(folder, ["J1", "J2"])
    assert len(campaign.poses) == 5
    assert "count as touches of their own: lines 6;" in campaign.notes[0]


ORIENTED = "time_s,artefact,feature,J1_rad,J2_rad,orientation_w,orientation_x,"
ORIENTED += "orientation_y,orientation_z\n"


def write_oriented(folder, *cells, artefact="grid,A", header=ORIENTED):
    rows = [
        f"{index}.5,{artefact},0.{index},0.2,{cell}\n"
        for index, cell in enumerate(cells)
    ]
    (folder / "poses.csv").write_text(header + "".join(rows))


def test_orientations_are_read_as_unit_quaternions(folder):
    write_oriented(folder, "0.5,-0.5,0.5,0.5003", ",,,", "-1,0,0,0")
    poses = read_campaign(folder, ["J1", "J2"], orientations=True).poses
    assert poses.oriented.tolist() == [True, False, True]
    assert np.linalg.norm(poses.orientations[[0, 2]], axis=1) == pytest.approx([1, 1])
    assert poses.orientations[2].tolist() == [-1, 0, 0, 0]
    assert poses.mounted == (0,)


@pytest.mark.parametrize(
    ("cells", "artefact", "message"),
    [
        ("0.5,0.5,0.5,0.6", "grid,A", "orientation has the length 1.05357; expected 1"),
        ("0.5,0.5,0.5,0.6", "grid,A", "a unit quaternion w, x, y, z"),
        ("1,0,0,", "grid,A", "give all four components or none"),
        ("1,0,0,x", "grid,A", "orientation_z: 'x' is not a finite number"),
        ("1,0,0,0", "cone-1,", "only points have a frame to measure it in"),
    ],
)
def test_orientations_that_are_none_are_refused(folder, cells, artefact, message):
    write_oriented(folder, cells, artefact=artefact)
    with pytest.raises(FileError) as caught:
        read_campaign(folder, ["J1", "J2"], orientations=True)
    assert any(message in str(problem) for problem in caught.value.problems)
    assert all("line 2" in str(problem) for problem in caught.value.problems)


def test_a_column_of_the_orientation_that_is_missing_is_named(folder):
    header = ORIENTED.replace(",orientation_z", "")
    write_oriented(folder, "1,0,0", header=header)
    assert problems(folder) == ["line 1: orientation_w needs orientation_z beside it"]


def test_orientations_are_for_identification_and_prediction_only(folder):
    write_oriented(folder, "1,0,0,0")
    (problem,) = problems(folder)
    assert "`traverse identify`, `diagnose` and `predict`" in problem
    assert "leave these columns out" in problem
    write_oriented(folder, ",,,")
    assert read_campaign(folder, ["J1", "J2"]).poses.mounted == ()
