import base64
import csv
import json

import pytest

from tests.client.display.test_inspection_desk import scan_of
from tests.client.inspection.touched import ARM, PLAN, touched_points
from tests.protocol.message_examples import SCAN
from tests.running import invoke
from traverse.protocol.encoding import encode
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.recording.views import cloud_to_bytes


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


def test_the_sheet_has_a_logo_and_what_is_none_is_refused(files):
    folder, _ = files
    picture = b"\x89PNG\r\n\x1a\n" + b"of a laboratory"
    (folder / "logo.png").write_bytes(picture)
    words = ["features", folder / "points.jsonl", "--plan", folder / "plan.toml"]
    words += ["--out", folder / "report", "--logo"]
    invoke(*words, folder / "logo.png", status=1)
    page = (folder / "report" / "features.html").read_text()
    assert f"base64,{base64.b64encode(picture).decode()}" in page
    refused = invoke(*words, folder / "plan.toml", status=2)
    assert "is no picture in PNG or JPEG" in refused.output


def test_without_the_arm_file_nothing_is_judged(files):
    folder, _ = files
    words = ["features", folder / "points.jsonl", "--plan", folder / "plan.toml"]
    ran = invoke(*words, "--json", status=1)
    report = json.loads(ran.stdout)
    assert report["uncertainty_unknown"] == "--arm is not given"
    figures = [f for feature in report["features"] for f in feature["figures"]]
    assert {figure["expanded"] for figure in figures} == {None}
    assert {figure["conformity"] for figure in figures} == {None, "not judged"}


def recording(path, clouds):
    with RunWriter(path, RunHead({"arm": "a", "version": "1"})) as writer:
        for cloud in clouds:
            writer.add(Entry("cloud", SCAN.time_ns, cloud))
    return path


SCANNED = """
[[features]]
name = "plate"
kind = "plane"
scan = "scan-3"
samples = [0, 59]

[[features]]
name = "hole a"
kind = "circle"
side = "inside"
plane = "plate"
scan = "scan-4"

[[tolerances]]
of = "hole a"
figure = "diameter"
nominal_mm = 20.0
lower_mm = -0.5
upper_mm = 0.5
"""


def test_features_are_measured_from_scans_of_a_recording(files):
    """Joints between the ends of a block are interpolated: each has two samples."""
    folder, truth = files
    blocks = [scan_of("plate", range(n, n + 2)) for n in range(0, 80, 2)]
    blocks += [
        scan_of("hole a", range(n, n + 2), scan="scan-4") for n in range(0, 80, 2)
    ]
    path = recording(folder / "run.mcap", [cloud_to_bytes(block) for block in blocks])
    plan = folder / "plan.toml"
    plan.write_text(PLAN[: PLAN.index("[[features]]")] + SCANNED)
    words = ["features", path, "--plan", plan]
    ran = invoke(*words, "--arm", ARM, "--out", folder / "report")
    assert "part: conforming" in ran.output
    report = json.loads((folder / "report" / "features.json").read_text())
    assert report["uncertainty_unknown"] == ""
    plate, hole = report["features"]
    counts = {key: plate["scans"][0][key] for key in ("scan", "used", "samples")}
    assert counts == {"scan": "scan-3", "used": 6, "samples": 60}
    figures = {figure["name"]: figure for figure in hole["figures"]}
    off_mm = abs(figures["diameter"]["value"] - truth["hole a diameter"])
    assert off_mm <= figures["diameter"]["expanded"] < 0.1
    plan.write_text(SCANNED.replace("scan-4", "scan-5"))
    assert "scans: scan-3, scan-4" in invoke(*words, status=2).output
    plan.write_text(SCANNED.replace("[0, 59]", "[59, 0]"))
    assert "samples = [first, last]" in invoke(*words, status=2).output
    plan.write_text(SCANNED)
    words[1] = folder / "points.jsonl"
    assert "only a recording" in invoke(*words, status=2).output
    earlier = json.loads(cloud_to_bytes(blocks[0]))
    del earlier["angles_rad"]
    words[1] = recording(folder / "old.mcap", [json.dumps(earlier).encode()])
    assert "an earlier version" in invoke(*words, status=2).output


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
