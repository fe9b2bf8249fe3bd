"""QIF against a file written by hand, read back, and held to the official schema."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from tests.client.display.values import point, retraction
from tests.client.exports.test_formats import POINTS, SCAN
from tests.official_schemas import SCHEMAS, needs_schemas
from traverse.cli.common.qif_check import SCHEMA, check_schema
from traverse.client.exports.qif import Qif
from traverse.strict_toml.problems import FileError

GOLDEN = Path(__file__).parent / "golden_points.qif"
IN = {"q": "http://qifstandards.org/xsd/qif3"}
SAME = {
    "session": "monday",
    "arm": "bench-7",
    "model": "abc",
    "ijk": [0.0, 0.6, -0.8],
    "surface_mm": None,
    "compensation": "none",
    "probe_radius_mm": 1.5,
}
START_NS = 1_795_227_247_000_000_000
TWO = [
    point(
        0,
        **SAME,
        xyz_mm=[1.25, -2.5, 3.0],
        time_ns=str(START_NS + 1),
        covariance_mm2=None,
        label={"artefact": "a & <b>", "feature": '"c"'},
        quality={"ok": True, "flags": []},
    ),
    point(
        1,
        **SAME,
        xyz_mm=[1234.56789, -9.0, 1e-4],
        time_ns=str(START_NS + 2),
        covariance_mm2=[4e-6, 1e-7, 0, 9e-6, 0, 1e-12],
        label={"artefact": None, "feature": None},
        quality={"ok": False, "flags": ["end_stop"]},
    ),
]


def written(points, **options):
    file = io.BytesIO()
    with Qif(file, **options) as sink:
        sink.points(points)
    return file.getvalue()


def test_file_is_the_one_written_by_hand():
    text = written(TWO).decode()
    identifier = re.search("<QPId>([0-9a-f-]{36})</QPId>", text)
    assert identifier is not None
    golden = GOLDEN.read_text("utf-8").replace("QPID", identifier[1])
    assert text == golden
    assert written(TWO).decode() == text
    assert identifier[1] not in written(TWO[:1]).decode()


def test_every_digit_is_read_back():
    root = etree.fromstring(written(POINTS))
    places = root.findall(".//q:PointFeatureMeasurement/q:Location", IN)
    places_mm = [[float(part) for part in place.text.split()] for place in places]
    np.testing.assert_array_equal(places_mm, [point.xyz_mm for point in POINTS])
    stds = [[place.get(f"{a}CombinedUncertainty") for a in "xyz"] for place in places]
    assert stds == [[None] * 3, *[["0.002", "0.003", "0.004"]] * 2]
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert ids == [str(number) for number in range(1, len(ids) + 1)]
    assert root.get("idMax") == ids[-1]
    for element in root.iter():
        if element.get("n"):
            assert int(element.get("n")) == len(element)


def test_each_session_has_results_of_its_own():
    points = [point(0, session="b"), point(1, session="a"), point(2, session="b")]
    root = etree.fromstring(written(points))
    sets = root.findall(".//q:MeasurementResults", IN)
    assert [results[0][0].get("value") for results in sets] == ["a", "b"]
    assert [len(results.find("q:MeasuredFeatures", IN)) for results in sets] == [1, 2]


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([point(1), retraction(2, 1)], "--retracted"),
        ([point(1, label={"artefact": "a\x07", "feature": None})], "XML does not have"),
    ],
)
def test_what_qif_cannot_hold_is_refused(points, expected):
    with pytest.raises(ValueError, match=expected):
        written(points)


def test_no_point_is_said():
    root = etree.fromstring(written([]))
    assert root.findtext(".//q:InspectionStatusEnum", None, IN) == "NOT_MEASURED"
    assert root.find(".//q:MeasuredFeatures", IN) is None


def test_scans_are_refused():
    with pytest.raises(ValueError, match="of scans"):
        Qif(io.BytesIO()).table(SCAN)


def schema_of(folder, root):
    text = f"""<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"
     targetNamespace="{IN["q"]}"><xs:element name="{root}"/></xs:schema>"""
    (folder / SCHEMA).write_text(text)


def test_content_is_held_to_a_schema_before_it_is_written(tmp_path):
    schema_of(tmp_path, "QIFDocument")
    check_schema(written(TWO), tmp_path / "points.qif", tmp_path)
    schema_of(tmp_path, "Another")
    with pytest.raises(FileError, match=r"schema: line 2: .*QIFDocument"):
        check_schema(written(TWO), tmp_path / "points.qif", tmp_path)


def test_schemas_in_two_folders_are_read_once_each(tmp_path):
    inside, beside = tmp_path / "QIFApplications", tmp_path / "QIFLibrary"
    head = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"
     targetNamespace="http://qifstandards.org/xsd/qif3">"""
    kind = '<xs:simpleType name="K"><xs:restriction base="xs:string"/></xs:simpleType>'
    root = '<xs:element name="QIFDocument"/>'
    for file, names, body in (
        (inside / SCHEMA, ["../QIFLibrary/A.xsd", "../QIFLibrary/B.xsd"], root),
        (beside / "A.xsd", ["B.xsd"], ""),
        (beside / "B.xsd", [], kind),
    ):
        file.parent.mkdir(exist_ok=True)
        includes = "".join(f'<xs:include schemaLocation="{name}"/>' for name in names)
        file.write_text(f"{head}{includes}{body}</xs:schema>")
    check_schema(written(TWO), tmp_path / "points.qif", inside)


@needs_schemas
def test_official_schema_accepts_it():
    check_schema(written([*TWO, *POINTS]), Path("points.qif"), SCHEMAS)
