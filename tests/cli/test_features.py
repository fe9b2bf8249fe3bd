import csv
import json

import pytest

from tests.client.inspection.touched import ARM, PLAN, touched_points
from tests.running import invoke
from traverse.protocol.encoding import encode


@pytest.fixture
def files(tmp_path):
    points, truth = touched_points()
    lines = b"\n".join(encode(point, "json") for point in points)
    (tmp_path / "points.jsonl").write_bytes(lines + b"\n")
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path, truth


def test_a_part_is_measured_within_its_uncertainty_and_reported(files):
    folder, truth = files
    words = ["features", folder / "points.jsonl", "--plan", folder / "plan.toml"]
    ran = invoke(*words, "--arm", ARM, "--out", folder / "report")
    assert "part: conforming" in ran.output
    report = json.loads((folder / "report" / "features.json").read_text())
    assert report["uncertainty_unknown"] == ""
    named = {
        f"{feature['name']} {figure['name']}": figure
        for feature in report["features"]
        for figure in feature["figures"]
    }
    for name, value in (
        ("hole a diameter", truth["hole a diameter"]),
        ("hole b diameter", truth["hole b diameter"]),
        ("shaft diameter", truth["shaft diameter"]),
        ("pitch distance", truth["hole a to hole b"]),
        ("height distance", truth["apex to plate"]),
        ("squareness angle", 90.0),
        ("hole a form", 0.0),
    ):
        figure = named[name]
        assert 0.0 < figure["expanded"] < 0.1
        assert abs(figure["value"] - value) <= figure["expanded"], name
    with (folder / "report" / "features.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["conformity"] for row in rows} == {"", "conforming"}
    assert "CIRCLE" in (folder / "report" / "features.dxf").read_text()
    assert "PlaneFeature" in (folder / "report" / "features.qif").read_text()
    page = (folder / "report" / "features.html").read_text()
    for text in ("plate 12", "0007", "A. Weber", report["model"], "ISO 14253-1"):
        assert text in page


def test_without_the_arm_file_nothing_is_judged(files):
    folder, _ = files
    words = ["features", folder / "points.jsonl", "--plan", folder / "plan.toml"]
    ran = invoke(*words, "--json", status=1)
    report = json.loads(ran.stdout)
    assert report["uncertainty_unknown"] == "--arm is not given"
    figures = [f for feature in report["features"] for f in feature["figures"]]
    assert {figure["expanded"] for figure in figures} == {None}
    assert {figure["conformity"] for figure in figures} == {None, "not judged"}


def test_mistakes_of_a_plan_are_told_all_at_once(files):
    folder, _ = files
    text = PLAN.replace('plane = "plate"', 'plane = "plat"', 1)
    text = text.replace("nominal_deg = 90.0", "nominal_mm = 90.0")
    (folder / "plan.toml").write_text(text)
    words = ["features", folder / "points.jsonl", "--plan", folder / "plan.toml"]
    ran = invoke(*words, status=2)
    assert "'plat'" in ran.output
    (folder / "plan.toml").write_text(text.replace('"plat"', '"plate"'))
    assert "nominal_deg" in invoke(*words, status=2).output
    (folder / "plan.toml").write_text('[[features]]\nname = "x"\nkind = "plane"\n')
    assert "labels there: cone, edge, hole a" in invoke(*words, status=2).output
