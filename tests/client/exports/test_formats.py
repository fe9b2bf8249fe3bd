import io
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import ezdxf
import numpy as np
import pandas
import pyarrow.parquet
import pytest
import trimesh

from tests.client.display.values import point, retraction
from traverse.client.exports.binary import PLY_ROW
from traverse.client.exports.formats import FORMATS, points_as
from traverse.client.exports.point_table import scan_table, standing, table_of
from traverse.client.exports.text import Template
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Label, Point, Quality

PLACES = [(1.25, -2.5, 3.0), (0.1, 0.2, 0.3), (1234.56789, -9.0, 1e-4)]
BOUNDS_NS = [None, 412_345, 0]
POINTS = [
    point(
        seq,
        xyz_mm=list(place),
        time_ns=str(1_795_251_247_000_000_000 + seq),
        time_bound_ns=BOUNDS_NS[seq],
        covariance_mm2=[4e-6, 0, 0, 9e-6, 0, 1.6e-5] if seq else None,
        quality={"ok": seq != 1, "flags": ["end_stop"] if seq == 1 else []},
    )
    for seq, place in enumerate(PLACES)
]
SCAN = scan_table(
    "day-shift",
    "scan-3",
    seq=np.arange(10, 14),
    time_ns=1_795_251_247_000_000_000 + np.arange(4) * 1_000_000,
    xyz_mm=np.arange(12.0).reshape(4, 3) / 7.0,
    ijk=np.tile([0.0, 0.6, -0.8], (4, 1)),
    quality=np.array([0, 1 << 6, 0, 1 << 14], dtype=np.uint32),
    covariance_mm2=np.array([[4e-6, 0, 0, 9e-6, 0, 1.6e-5]] * 4),
)
# Another session of the same outbox begins again with the same numbers.
SESSIONS = [POINTS[0].session, "night-shift"]
TWO = [
    p.model_copy(update={"session": s, "id": f"{s}-{p.seq}"})
    for s in SESSIONS
    for p in POINTS
]
KEYS = [(p.session, p.seq) for p in TWO]


def written(kind: str, tmp_path: Path, **options: str) -> Path:
    path = tmp_path / f"points.{kind}"
    with path.open("wb") as file, FORMATS[kind](file, **options) as sink:
        sink.points(POINTS[:2])
        sink.points(POINTS[2:])
    assert sink.n == 3
    return path


def scanned(kind: str, tmp_path: Path) -> Path:
    path = tmp_path / f"scan.{kind}"
    with path.open("wb") as file, FORMATS[kind](file) as sink:
        sink.table(SCAN)
    return path


def test_csv_in_pandas(tmp_path: Path) -> None:
    table = pandas.read_csv(written("csv", tmp_path))
    assert table[["x_mm", "y_mm", "z_mm"]].to_numpy().tolist() == [
        list(place) for place in PLACES
    ]
    assert table["seq"].tolist() == [0, 1, 2]
    assert table["ok"].tolist() == [1, 0, 1]
    assert table["flags"].tolist()[1] == "end_stop"
    assert table["covariance_yy_mm2"].isna().tolist() == [True, False, False]
    scan = pandas.read_csv(scanned("csv", tmp_path))
    assert (scan[["x_mm", "y_mm", "z_mm"]].to_numpy() == SCAN.xyz_mm).all()
    assert scan["ok"].tolist() == [1, 0, 1, 1]  # interpolated is a remark
    for frame in (table, scan):
        moments = pandas.to_datetime(frame["time_utc"]).dt.tz_localize(None)
        ns = moments.astype("datetime64[ns]").astype("int64")
        assert ns.tolist() == frame["time_ns"].tolist()
        assert frame["time_utc"].str.endswith("Z").all()


@pytest.mark.parametrize("kind", ["csv", "parquet", "npz", "jsonl", "text"])
def test_how_far_the_time_may_be_off_goes_along(kind: str, tmp_path: Path) -> None:
    options = {"template": "{seq};{time_bound_ns}\n"} if kind == "text" else {}
    path = written(kind, tmp_path, **options)
    if kind == "text":
        assert path.read_text().split() == ["0;", "1;412345", "2;0"]
        return
    table = {
        "csv": pandas.read_csv,
        "parquet": pandas.read_parquet,
        "npz": np.load,
        "jsonl": lambda path: pandas.read_json(path, lines=True),
    }[kind](path)
    stated_ns = np.array(BOUNDS_NS, dtype=np.float64)
    np.testing.assert_array_equal(np.array(table["time_bound_ns"]), stated_ns)


def test_tables_for_spreadsheets_with_a_decimal_comma(tmp_path: Path) -> None:
    path = written("csv", tmp_path, decimal=",")
    table = pandas.read_csv(path, sep=";", decimal=",")
    assert table[["x_mm", "y_mm", "z_mm"]].to_numpy().tolist() == [
        list(place) for place in PLACES
    ]
    # No number of them has a point, which would be read as one of thousands.
    numbers = table.columns.difference(["session", "id", "model", "time_utc"])
    texts = pandas.read_csv(path, sep=";", dtype=str)[numbers].fillna("").to_numpy()
    assert not any("." in cell for cell in texts.ravel())
    assert "," in texts[0, numbers.get_loc("x_mm")]
    lines = written("xyz", tmp_path, decimal=",").read_text("ascii").split("\n")
    x, y, z = (float(word.replace(",", ".")) for word in lines[0].split())
    np.testing.assert_allclose((x, y, z), PLACES[0], atol=1e-6)
    assert "." not in lines[0]


def test_json_lines_are_the_messages(tmp_path: Path) -> None:
    lines = written("jsonl", tmp_path).read_bytes().splitlines()
    assert [decode(Point, line, "json") for line in lines] == POINTS
    table = pandas.read_json(scanned("jsonl", tmp_path), lines=True)
    assert table["seq"].tolist() == [10, 11, 12, 13]


def test_ply_in_trimesh(tmp_path: Path) -> None:
    cloud = trimesh.load(written("ply", tmp_path))
    np.testing.assert_array_equal(cloud.vertices, PLACES)
    rows = cloud.metadata["_ply_raw"]["vertex"]["data"]
    assert rows["quality"].ravel().tolist() == [0, 1 << 6, 0]
    np.testing.assert_allclose(rows["std_y"].ravel()[1:], 3e-3, rtol=1e-6)
    assert np.isnan(rows["std_y"].ravel()[0])
    scan = trimesh.load(scanned("ply", tmp_path))
    np.testing.assert_array_equal(scan.vertices, SCAN.xyz_mm)
    text = (tmp_path / "scan.ply").read_bytes().partition(b"end_header\n")
    assert len(text[2]) == 4 * PLY_ROW.itemsize


def test_xyz_in_numpy(tmp_path: Path) -> None:
    np.testing.assert_allclose(
        np.loadtxt(written("xyz", tmp_path)), PLACES, atol=5e-7, rtol=0
    )


def drawn(path: Path) -> ezdxf.document.Drawing:
    """A drawing as a CAD program reads it, without a fault."""
    drawing = ezdxf.readfile(path)
    assert not (audit := drawing.audit()).has_issues, audit.errors + audit.fixes
    millimetres, metric = 4, 1
    assert drawing.header["$INSUNITS"] == millimetres
    assert drawing.header["$MEASUREMENT"] == metric
    return drawing


def test_points_in_a_drawing(tmp_path: Path) -> None:
    labels = [
        {"artefact": "plate", "feature": "hole/1"},
        {"artefact": "Plate", "feature": "hole/1"},
        {"artefact": "Pl\u00e4tte"},
        {},
    ]
    points = [
        *POINTS,
        *(POINTS[0].model_copy(update={"label": Label(**label)}) for label in labels),
    ]
    path = tmp_path / "points.dxf"
    with path.open("wb") as file, FORMATS["dxf"](file) as sink:
        sink.points(points)
    drawing = drawn(path)
    places = [
        (point.dxf.layer, tuple(point.dxf.location)) for point in drawing.query("POINT")
    ]
    assert [place for _, place in places[:3]] == PLACES
    layers = [layer.removeprefix(f"{POINTS[0].session}") for layer, _ in places]
    usual = " bar 1"
    plates = [" plate hole_1", " Plate hole_1", " Pl\u00e4tte"]
    assert layers == [usual, "in doubt", usual, *plates, ""]
    assert all(layer in drawing.layers for layer, _ in places)  # "Plate" is "plate"
    low_mm = np.min([touched.xyz_mm for touched in points], axis=0)
    assert list(drawing.header["$EXTMIN"]) == low_mm.tolist()


def test_scans_in_a_drawing(tmp_path: Path) -> None:
    path = tmp_path / "scans.dxf"
    with path.open("wb") as file, FORMATS["dxf"](file) as sink:
        sink.table(SCAN)
        sink.table(replace(SCAN, seq=SCAN.seq + 4))
        fine = np.zeros(4, dtype=np.uint32)
        sink.table(replace(SCAN, quality=fine, ok=fine == 0))
    drawing = drawn(path)
    first, doubtful, *kept = [tuple(row) for row in SCAN.xyz_mm.tolist()]
    lines = [
        (line.dxf.layer, [tuple(place) for place in line.points()])
        for line in drawing.query("POLYLINE")
    ]
    assert lines == [
        ("scan 1", [*kept, first]),
        ("scan 1", kept),
        ("scan 2", [first, doubtful, *kept]),
    ]
    points = [
        (point.dxf.layer, tuple(point.dxf.location)) for point in drawing.query("POINT")
    ]
    assert points == [("scan 1", first), *[("in doubt", doubtful)] * 2]


def test_a_template_writes_lines_of_ones_own_form(tmp_path: Path) -> None:
    template = r"{seq:03d}\t{x_mm:.2f};{covariance_xx_mm2}{{mm}}\n"
    lines = written("text", tmp_path, template=template).read_text().splitlines()
    assert lines == ["000\t1.25;{mm}", "001\t0.10;4e-06{mm}", "002\t1234.57;4e-06{mm}"]


@pytest.mark.parametrize(
    "template",
    [
        "",
        "{seq.__class__}",
        "{seq[0]}",
        "{nothing}",
        "{seq!r}",
        "{x_mm:{seq}}",
        "{}",
        "x" * 1001,
        "{seq",
    ],
)
def test_a_template_cannot_reach_beyond_a_points_values(template: str) -> None:
    with pytest.raises(ValueError, match=r"template|expected '}'|Single|brace"):
        Template(io.BytesIO(), template=template)


def test_a_form_that_does_not_fit_its_value_is_reported() -> None:
    with pytest.raises(ValueError, match=r"\{session:d\}.*value is"):
        Template(io.BytesIO(), template="{session:d}")


def test_what_was_taken_back_is_left_out() -> None:
    points = [*POINTS, retraction(3, of=1)]
    assert [p.seq for p in standing(points)] == [0, 2]
    name, content = points_as("jsonl", points)
    assert name == "points.jsonl"
    assert [json.loads(line)["seq"] for line in content.splitlines()] == [0, 2]


@pytest.mark.parametrize(
    ("coordinates", "changes", "expected"),
    [
        ("surface", {"surface_mm": None, "compensation": "none"}, "no touched point"),
        ("part", {"part_xyz_mm": None}, "without an alignment"),
    ],
)
def test_coordinates_that_a_point_does_not_have_are_refused(
    coordinates: str, changes: dict[str, object], expected: str
) -> None:
    with pytest.raises(ValueError, match=expected):
        table_of([point(0, **changes)], coordinates)  # type: ignore[arg-type] # a name


@pytest.mark.parametrize("kind", sorted(set(FORMATS) - {"text"}))
def test_nothing_is_a_good_file_too(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"none.{kind}"
    with path.open("wb") as file, FORMATS[kind](file) as sink:
        sink.points([])
    assert sink.n == 0
    if kind == "ply":
        assert b"element vertex 0\n" in path.read_bytes()


def two_sessions(kind: str, tmp_path: Path) -> Path:
    path = tmp_path / f"two.{kind}"
    with path.open("wb") as file, FORMATS[kind](file) as sink:
        sink.points(TWO)
    assert (sink.n, sink.in_doubt) == (6, 2)
    return path


def test_npz_has_the_whole_identity_and_quality(tmp_path: Path) -> None:
    with np.load(two_sessions("npz", tmp_path)) as columns:
        keys = zip(columns["session"].tolist(), columns["seq"].tolist(), strict=True)
        assert list(keys) == KEYS
        np.testing.assert_array_equal(columns["xyz_mm"], PLACES * 2)
        assert columns["time_ns"].tolist() == [p.time_ns for p in TWO]
        np.testing.assert_allclose(columns["std_mm"][2], [2e-3, 3e-3, 4e-3])
        assert columns["id"].tolist() == [p.id for p in TWO]
        assert columns["ok"].tolist() == [True, False, True] * 2
        assert columns["flags"].tolist() == ["", "end_stop", ""] * 2
        assert columns["artefact"].tolist() == ["bar"] * 6
        assert columns["feature"].tolist() == ["1"] * 6
        assert columns["coordinates"] == "centre"
        covariance = columns["covariance_mm2"]
        assert np.isnan(covariance[0]).all()
        assert covariance[1].tolist() == [4e-6, 0, 0, 9e-6, 0, 1.6e-5]


def test_parquet_has_the_whole_identity_and_quality(tmp_path: Path) -> None:
    table = pyarrow.parquet.read_table(two_sessions("parquet", tmp_path))
    assert table.schema.metadata[b"coordinates"] == b"centre"
    assert table["std_y_mm"].null_count == 2
    rows = table.to_pylist()
    assert [row["x_mm"] for row in rows] == [x for x, _, _ in PLACES] * 2
    moment = datetime.fromtimestamp(POINTS[0].time_ns // 10**9, UTC)
    assert rows[0]["time"].to_pydatetime() == moment
    assert [(row["session"], row["seq"]) for row in rows] == KEYS
    assert [row["id"] for row in rows] == [p.id for p in TWO]
    assert [row["ok"] for row in rows] == [True, False, True] * 2
    assert [row["flags"] for row in rows] == ["", "end_stop", ""] * 2
    assert {(row["artefact"], row["feature"], row["scan"]) for row in rows} == {
        ("bar", "1", None)
    }
    assert rows[0]["covariance_yy_mm2"] is None
    assert rows[1]["covariance_yy_mm2"] == 9e-6
    assert b"session and seq" in table.schema.metadata[b"key"]
    scan = pyarrow.parquet.read_table(scanned("parquet", tmp_path)).to_pylist()
    assert [(row["scan"], row["seq"]) for row in scan] == [
        ("scan-3", seq) for seq in (10, 11, 12, 13)
    ]
    assert [row["ok"] for row in scan] == [True, False, True, True]


def test_ply_numbers_what_it_cannot_name_and_says_what_it_lacks(tmp_path: Path) -> None:
    path = two_sessions("ply", tmp_path)
    rows = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
    assert rows["series"].ravel().tolist() == [0, 0, 0, 1, 1, 1]
    assert rows["seq"].ravel().tolist() == [0, 1, 2] * 2
    assert rows["ok"].ravel().tolist() == [1, 0, 1] * 2
    np.testing.assert_allclose(rows["cov_zz"].ravel()[1:3], 1.6e-5, rtol=1e-6)
    head = path.read_bytes().partition(b"end_header")[0].decode("ascii").splitlines()
    for number, session in enumerate(SESSIONS):
        assert f"comment series {number}: session {session}" in head
    assert "comment label 0: bar 1" in head
    assert "comment not in this file: ids and times of points" in head
    scan = scanned("ply", tmp_path).read_bytes()
    assert b"comment series 0: scan scan-3 of session day-shift\n" in scan


def test_a_label_cannot_break_the_head_of_a_ply(tmp_path: Path) -> None:
    label = Label(artefact="Pl\u00e4tte\nend_header\n", feature=None)
    path = tmp_path / "label.ply"
    with path.open("wb") as file, FORMATS["ply"](file) as sink:
        sink.points([POINTS[0].model_copy(update={"label": label})])
    np.testing.assert_array_equal(trimesh.load(path).vertices, PLACES[:1])


def test_a_drawing_says_of_each_point_which_it_is(tmp_path: Path) -> None:
    drawing = drawn(two_sessions("dxf", tmp_path))
    entries = [
        dict(text.split("=", 1) for _, text in point.get_xdata("TRAVERSE"))
        for point in drawing.query("POINT")
    ]
    assert [(entry["session"], int(entry["seq"])) for entry in entries] == KEYS
    assert [entry["ok"] for entry in entries] == ["true", "false", "true"] * 2
    assert entries[1]["flags"] == "end_stop"
    assert entries[1]["covariance_mm2"].split()[3] == "9e-06"
    assert (entries[0]["artefact"], "covariance_mm2" in entries[0]) == ("bar", False)
    scans = drawn(scanned("dxf", tmp_path))
    data = [
        dict(text.split("=", 1) for _, text in entity.get_xdata("TRAVERSE"))
        for entity in scans.modelspace()
    ]
    assert {(of["session"], of["scan"]) for of in data} == {("day-shift", "scan-3")}


def test_scans_of_two_sessions_are_two_lines_whatever_their_numbers(tmp_path) -> None:
    path, fine = tmp_path / "two.dxf", np.zeros(4, np.uint32)
    sound = replace(SCAN, quality=fine, ok=fine == 0)
    with path.open("wb") as file, FORMATS["dxf"](file) as sink:
        sink.table(sound)
        # The first points of the other one were lost.
        sink.table(replace(sound, session=np.full(4, "night"), seq=SCAN.seq + 9))
    assert len(drawn(path).query("POLYLINE")) == 2


def test_a_flag_of_a_later_version_marks_as_well(tmp_path: Path) -> None:
    later = POINTS[0].model_copy(
        update={"quality": Quality(ok=False, flags=("bit_31", "never_heard_of"))}
    )
    table = table_of([later], "centre")
    assert table.quality.tolist() == [1 << 31]
    assert (table.ok.tolist(), table.flags.tolist()) == (
        [False],
        ["bit_31 never_heard_of"],
    )


@pytest.mark.parametrize("kind", sorted(set(FORMATS) - {"text"}))
def test_part_coordinates_without_an_alignment_are_refused_by_each(
    kind: str, tmp_path: Path
) -> None:
    aligned = POINTS[0].model_copy(update={"part_xyz_mm": (1.0, 2.0, 3.0)})
    path = tmp_path / "part"
    with (
        pytest.raises(ValueError, match=r"point 7 of session .* alignment"),
        path.open("wb") as file,
        FORMATS[kind](file, "part") as sink,
    ):
        sink.points([aligned, point(7, part_xyz_mm=None)])
