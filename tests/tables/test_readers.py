"""Every reader of tables reads every dialect alike, or refuses it; never other numbers.

The table of docs/reference/tables.md comes from it.
"""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT
from tests.tables.dialects import DIALECTS, PLAIN, Dialect, written
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.importers.dh_file import Units, read_dh_file
from traverse.lab.alignment.touches import read_touch_table
from traverse.lab.campaign.campaign_file import read_campaign_file, read_points
from traverse.lab.campaign.pose_table import read_pose_table
from traverse.lab.measured_points.reading import read_points_table
from traverse.simulator.scenario.recorded_counts import read_recording
from traverse.strict_toml.problems import FileError

PAGE = Path(__file__).parents[2] / "docs/reference/tables.md"


def dh(path):
    rows = read_dh_file(path, Units()).rows
    rad_deg = 180.0 / 3.141592653589793
    return [
        (row.name, row.d_mm, row.a_mm, row.alpha_rad * rad_deg, row.theta_rad * rad_deg)
        for row in rows
    ]


def poses(path):
    read = read_pose_table(path, ["J1"], {"seat": ("up", "down")}).poses
    names = [("up", "down")[number] for number in read.features]
    numbers = (read.time_s, names, read.angles_rad[:, 0], read.temperature_c)
    return [(t, "seat", name, a, c) for t, name, a, c in zip(*numbers, strict=True)]


def points(path):
    return [(name, *place) for name, place in read_points(path).items()]


def touches(path):
    return [(t.names[0], *t.place_mm) for t in read_touch_table(path, "centre")]


def verify(path):
    toml = path.with_name("campaign.toml")
    toml.write_text(
        'schema = "traverse/campaign/1"\nposes = "p.csv"\n'
        '[[artefacts]]\nid = "seat"\nkind = "cone"\n'
    )
    measured = read_points_table(path, read_campaign_file(toml), parse_arm(ARM_TEXT))
    touched = measured.touched["seat"]
    rows = zip(touched.features, touched.places_mm.tolist(), strict=True)
    return [("seat", feature, *place) for feature, place in rows]


def counts(path):
    recording = read_recording(path)
    columns = [recording.times_s, *recording.columns.values()]
    return list(zip(*columns, strict=True))


PLACES = ["x_mm", "y_mm", "z_mm"]
READERS = {
    "from-dh": (
        dh,
        ["name", "d_mm", "a_mm", "alpha_deg", "theta_deg"],
        [("J1", 1400.5, 25.25, -90.0, 0.5), ("J2", 0.5, 455.25, 0.0, -90.5)],
    ),
    "campaign poses": (
        poses,
        ["time_s", "artefact", "feature", "J1_rad", "temperature_c"],
        [(0.5, "seat", "up", 0.1, 20.5), (1001.5, "seat", "down", -0.25, 21.25)],
    ),
    "campaign points": (
        points,
        ["feature", *PLACES],
        [("A", 1012.5, -3.25, 100.125), ("B", 512.5, 0.5, 1.0)],
    ),
    "align, nominal": (
        touches,
        ["name", *PLACES],
        [("A", 1012.5, -3.25, 100.125), ("B", 512.5, 0.5, 1.0)],
    ),
    "verify points": (
        verify,
        ["artefact", "feature", *PLACES],
        [("seat", "1", 1012.5, -3.25, 100.125), ("seat", "2", 512.5, 0.5, 1.0)],
    ),
    "recorded counts": (
        counts,
        ["time_s", "base/0", "base/1"],
        [(0.0, 8388608, 3), (1.25, 8388607, 1234567)],
    ),
}


def outcome(path, name, reader):
    read, header, rows = READERS[reader]
    path.write_bytes(written(name, header, rows))
    try:
        rows_read = read(path)
    except FileError:
        return "refused"
    for row, expected in zip(rows_read, rows, strict=True):
        for value, right in zip(row, expected, strict=True):
            same = value == right or value == pytest.approx(right, rel=1e-15, abs=0)
            assert same, (reader, name, row, expected)
    return "read"


def documented():
    lines = PAGE.read_text("utf-8").splitlines()
    start = next(
        number for number, line in enumerate(lines) if line.startswith("| dialect |")
    )
    rows = {}
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        name, *cells = (cell.strip() for cell in line.strip("|").split(" | "))
        rows[name] = cells
    return rows


def test_the_page_lists_the_readers_and_the_dialects():
    rows = documented()
    assert rows.pop("dialect") == list(READERS)
    assert [name for name in rows if not name.startswith("-")] == list(DIALECTS)


@pytest.mark.parametrize("reader", READERS)
def test_a_dialect_is_read_right_or_refused_as_the_page_says(tmp_path, reader):
    column = list(READERS).index(reader)
    expected = {name: documented()[name][column] for name in DIALECTS}
    outcomes = {name: outcome(tmp_path / "p.csv", name, reader) for name in DIALECTS}
    assert outcomes == expected


numbers = st.integers(-(10**9), 10**9).flatmap(
    lambda digits: st.integers(0, 4).map(lambda power: digits / 10**power)
)
# Marks for thousands that go with a decimal mark, and what is between columns.
WRITINGS = [
    (",", ".", ""),
    (",", ".", "'"),
    (",", ".", ","),
    (",", ",", ""),
    (",", ",", "."),
    (";", ".", ""),
    (";", ",", ""),
    (";", ",", "'"),
    (";", ",", "."),
    (";", ",", "\u00a0"),
    ("\t", ".", ""),
    ("\t", ".", ","),
    ("\t", ",", ""),
    ("\t", ",", "."),
    ("\t", ",", "\u202f"),
]


@st.composite
def dialects(draw):
    separator, decimal, group = draw(st.sampled_from(WRITINGS))
    # A point by itself is the decimal one, as the page says.
    fewest = 1 if group == "." else 0
    trailing = draw(st.sampled_from(["", separator, 2 * separator]))
    return Dialect(
        separator=separator,
        decimal=decimal,
        group=group,
        decimals=draw(st.integers(fewest, 5)),
        minus=draw(st.sampled_from("-\u2212\u2013\u2010")),
        end=draw(st.sampled_from(["\n", "\r\n", "\r"])),
        encoding=draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])),
        first=draw(st.sampled_from(["", f"sep={separator}"])),
        blank=draw(st.sampled_from(["", " "])),
        trailing=trailing,
        trailing_header=draw(st.sampled_from(["", trailing])),
        comment=draw(st.sampled_from(["", "# a, comment; of\tsome"])),
        quoted=draw(st.booleans()),
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    dialects(), st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=4)
)
def test_no_dialect_gives_other_numbers(tmp_path, dialect, places):
    path = tmp_path / "p.csv"
    rows = [
        (f"P{index}", *(round(number, dialect.decimals) for number in place))
        for index, place in enumerate(places)
    ]
    header = ["name", *PLACES]
    path.write_bytes(dialect.table(header, rows))
    try:
        touches = read_touch_table(path, "centre")
    except FileError as error:
        refused = str(error)
        touches = []
    # Only a comma that may be one of thousands is ever refused.
    maybe = dialect.separator != ";" and "," in (dialect.decimal, dialect.group)
    assert touches or maybe, refused
    if touches:
        read = {touch.names[0]: touch.place_mm.tolist() for touch in touches}
        assert read == {name: list(place) for name, *place in rows}


REFUSED = {
    "name,x_mm,y_mm,z_mm\nA,1,2\n": "line 2: has 3 cells; the header has 4",
    "name,x_mm,y_mm,z_mm\nA,1,5,2,3\n": "decimal commas need ';' or tabs",
    "name,x_mm;y_mm,z_mm\n": "line 1: has ',' and ';' between its columns",
    "name x_mm y_mm z_mm\nA 1 2 3\n": "has blanks between its columns; expected ','",
    "name,x_mm,y_mm,x_mm\n": "column 'x_mm' stands there twice",
    "sep=|\nname|x_mm\n": "line 1: 'sep=|' is not valid here",
    "sep=;\nname,x_mm,y_mm,z_mm\n": "line 2: has ',', but line 1 names another",
    "# nothing\n\n": "holds no table",
    ",,,\n": "holds no table",
    "": "holds no table",
    'name,x_mm,y_mm,z_mm\n"A,1,2,3\nB,1,2,3\n': "ends within a cell in quotes",
    'name,x_mm,y_mm,z_mm\n"A\nB",1,2,3\n': "goes on over the end of a line",
    'name,x_mm,y_mm,z_mm\n"A"B,1,2,3\n': "line 2: is not CSV",
    "name,x_mm,y_mm,z_mm\n#1,1,2,3\n": "line 2: begins with '#1': a comment, or a row?",
    'name\tx_mm\ty_mm\tz_mm\nA\t"1,234"\t2\t3\n': "line 2: '1,234' may be 1.234 or",
    "name,x_mm,y_mm,z_mm,std_mm\nA,1,2,3,1,\n": "an empty cell beyond the 5",
    "name,x_mm,y_mm,z_mm\nA,1,2,\u2212x\n": "a finite number; it has U+2212 MINUS",
    "name,x_mm,y_mm,z_mm\nA,1,,3\n": "column y_mm: '' is not a finite number",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_doubtful_is_refused_with_its_place(tmp_path, text):
    path = tmp_path / "p.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(FileError) as refused:
        read_touch_table(path, "centre")
    assert REFUSED[text] in str(refused.value)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"\xff\xfen\x00a", "UTF-16"),
        (
            b"name,x_mm\nA\xb0,1\n",
            "line 2, column 2: byte 0xb0 (in Windows-1252 "
            "U+00B0 DEGREE SIGN) is not UTF-8; save the file as UTF-8",
        ),
        (b"PAR1abc", "a Parquet file; write it as CSV"),
        (b"\xd0\xcf\x11\xe0abc", "an Excel workbook; save its sheet as CSV"),
        (b"\x1f\x8b\x08", "compressed by gzip"),
        (b"a" * 2**21, "has more than 1048576 characters"),
    ],
    ids=["utf-16", "latin", "parquet", "xls", "gzip", "long"],
)
def test_what_is_no_text_is_refused_as_what_it_is(tmp_path, content, expected):
    path = tmp_path / "p.csv"
    path.write_bytes(content)
    with pytest.raises(FileError) as refused:
        read_touch_table(path, "centre")
    if expected != "UTF-16":
        assert expected in str(refused.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(FileError, match="cannot be read: No such file"):
        read_touch_table(tmp_path / "none.csv", "centre")


def test_lines_are_those_of_the_file(tmp_path):
    path = tmp_path / "p.csv"
    path.write_bytes(
        b"# a\r\n\r\nname,x_mm,y_mm,z_mm\r\n# b\r\nA,1,2,3\r\n,,,\r\nB,x,2,3\r\n"
    )
    with pytest.raises(FileError) as refused:
        read_touch_table(path, "centre")
    assert [p.where for p in refused.value.problems] == ["line 7, column x_mm"]


def test_a_name_in_quotes_may_begin_with_a_number_sign(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text('name,x_mm,y_mm,z_mm\n"#1",1,2,3\n#A commented row, 1\n')
    assert [t.names for t in read_touch_table(path, "centre")] == [("#1",)]
    assert PLAIN.table(["a"], [("b",)]) == b"a\nb\n"
