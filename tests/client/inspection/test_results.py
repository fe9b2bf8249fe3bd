from html import unescape

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.client.inspection.touched import ARM, PLAN, touched_points
from traverse.client.inspection.plan import PartTemperature, Plan, ToleranceEntry
from traverse.client.inspection.results import inspected
from traverse.client.inspection.sheet import sheet_html, summary_lines
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.measured_points.touch_errors import shared_by_points
from traverse.protocol.messages import Quality
from traverse.strict_toml.reader import parse_strict

TURN, SHIFT_MM = Rotation.from_rotvec([0.2, -0.4, 1.0]), np.array([10.0, -5.0, 3.0])


@pytest.fixture(scope="module")
def plan() -> Plan:
    return parse_strict(PLAN, "plan", Plan)


@pytest.fixture(scope="module")
def shared():
    points, _ = touched_points()
    factors = shared_by_points(points, ARM, read_arm(ARM))
    return {point.id: factor for point, factor in zip(points, factors, strict=True)}


def by_name(inspection):
    return {feature.name: feature for feature in inspection.features}


def figure(inspection, feature, name):
    return {f.name: f for f in by_name(inspection)[feature].figures}[name]


def test_points_in_doubt_are_named_and_nothing_that_rests_on_them_is_judged(
    plan, shared
):
    points, _ = touched_points()
    quality = Quality(ok=False, flags=("singular",))
    doubtful = points[0].model_copy(update={"quality": quality})
    inspection = inspected(plan, [doubtful, *points[1:]], shared)
    assert by_name(inspection)["plate"].touches[0].doubts == ("singular",)
    assert figure(inspection, "hole a", "diameter").conformity == "not judged"
    assert figure(inspection, "pitch", "distance").conformity == "not judged"
    assert inspection.conformity == "not judged"
    assert "singular" in sheet_html(inspection)


def test_lengths_are_judged_once_ball_and_temperature_are_stated(plan, shared):
    points, _ = touched_points()
    complete = inspected(plan, points, shared)
    assert complete.left_out == ()
    assert figure(complete, "hole a", "diameter").conformity == "conforming"
    for missing in ("ball_radius_std_mm", "part_temperature"):
        lacking = plan.model_copy(update={missing: None})
        inspection = inspected(lacking, points, shared)
        assert len(inspection.left_out) == 1
        assert missing in inspection.left_out[0]
        assert inspection.left_out[0] in unescape(sheet_html(inspection))
        assert inspection.left_out[0] in summary_lines(inspection)
        assert figure(inspection, "hole a", "diameter").conformity == "not judged"
        assert figure(inspection, "pitch", "distance").conformity == "not judged"
        assert figure(inspection, "squareness", "angle").conformity == "conforming"


def test_lengths_of_a_warm_part_are_those_at_20_degrees(plan, shared):
    points, _ = touched_points()
    warm = PartTemperature(
        temperature_c=30.0,
        temperature_std_c=2.0,
        expansion_per_c=23e-6,
        expansion_std_per_c=5e-6,
    )
    cold_plan = plan.model_copy(update={"part_temperature": None})
    warm_plan = plan.model_copy(update={"part_temperature": warm})
    as_touched, at_20 = (inspected(p, points, shared) for p in (cold_plan, warm_plan))
    pitch, reference = (figure(i, "pitch", "distance") for i in (as_touched, at_20))
    assert reference.value == pytest.approx(pitch.value / (1 + 23e-5), rel=1e-12)
    # By hand: 50 mm x root((23e-6 x 2)^2 + (5e-6 x 10)^2 + (5e-6 x 2)^2), k = 2.
    added_mm = 2 * pitch.value * np.sqrt(46e-6**2 + 50e-6**2 + 10e-6**2)
    expected_mm = np.hypot(pitch.expanded, added_mm)
    assert reference.expanded == pytest.approx(expected_mm, rel=1e-3)
    for name, of in (("squareness", "angle"), ("hole a", "x")):
        assert figure(as_touched, name, of) == figure(at_20, name, of)


def test_coordinates_of_the_part_are_not_judged(plan, shared):
    """Its alignment has an error that their U leaves out."""
    points, _ = touched_points()
    limits = {"nominal_mm": 0.0, "lower_mm": -1e4, "upper_mm": 1e4}
    entry = ToleranceEntry.model_validate({"of": "hole a", "figure": "x", **limits})
    expected = plan.model_copy(update={"tolerances": (entry,)})
    aligned = [p.model_copy(update={"part_xyz_mm": p.xyz_mm}) for p in points]
    in_arm, in_part = (inspected(expected, each, shared) for each in (points, aligned))
    assert (in_arm.conformity, in_part.conformity) == ("conforming", "not judged")
    assert "alignment" in in_part.left_out[0]


def test_points_can_be_listed_in_place_of_labels(plan, shared):
    points, truth = touched_points()
    of_a = [p.id for p in points if p.label.feature == "hole a"]
    entries = [
        entry.model_copy(update={"points": tuple(of_a)})
        if entry.name == "hole b"
        else entry
        for entry in plan.features
    ]
    changed = plan.model_copy(update={"features": tuple(entries)})
    inspection = inspected(changed, points, shared)
    value = figure(inspection, "hole b", "diameter").value
    assert value == pytest.approx(truth["hole a diameter"], abs=0.05)
    assert figure(inspection, "pitch", "distance").value == pytest.approx(0.0)


def test_with_an_alignment_coordinates_are_the_parts(plan, shared):
    points, _ = touched_points()
    aligned = [
        p.model_copy(update={"part_xyz_mm": tuple(TURN.apply(p.xyz_mm) + SHIFT_MM)})
        for p in points
    ]
    in_arm, in_part = (inspected(plan, each, shared) for each in (points, aligned))
    assert (in_arm.system, in_part.system) == ("arm", "part")
    place_mm = [figure(in_arm, "hole a", axis).value for axis in "xyz"]
    in_part_mm = [figure(in_part, "hole a", axis).value for axis in "xyz"]
    np.testing.assert_allclose(in_part_mm, TURN.apply(place_mm) + SHIFT_MM)
    for feature, name in (("pitch", "distance"), ("hole a", "diameter")):
        in_arm_system, other = (
            figure(each, feature, name) for each in (in_arm, in_part)
        )
        assert in_arm_system.value == pytest.approx(other.value)
        assert in_arm_system.expanded == pytest.approx(other.expanded, rel=1e-6)
    assert "alignment" in sheet_html(in_part)


def test_points_of_different_probes_have_no_uncertainty(plan, shared):
    points, _ = touched_points()
    other = points[3].model_copy(update={"model": "0" * 64, "probe_radius_mm": 2.0})
    inspection = inspected(plan, [*points[:3], other, *points[4:]], shared)
    assert "different arm files or probes" in inspection.uncertainty_unknown
    assert figure(inspection, "hole a", "diameter").expanded is None


def test_features_without_points_say_so(plan):
    inspection = inspected(plan, [], "no points")
    assert {f.problem for f in inspection.features[:6]} == {"not touched yet"}
    assert by_name(inspection)["pitch"].problem == "hole a, hole b: not measured"
    assert "<main>" in sheet_html(inspection)


def test_texts_from_outside_are_escaped_on_the_sheet(plan):
    hostile = plan.model_copy(update={"part": "<script>x</script>", "serial": "a\x1bb"})
    page = sheet_html(inspected(hostile, [], ""))
    assert "<script>" not in page
    assert "\x1b" not in page
