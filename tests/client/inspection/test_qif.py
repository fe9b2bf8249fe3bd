"""Features as QIF, read by lxml, and held to the official schema where it is given."""

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from tests.client.inspection.touched import ARM, PLAN, touched_points
from tests.official_schemas import SCHEMAS, needs_schemas
from traverse.cli.common.qif_check import check_schema
from traverse.client.inspection.plan import Plan
from traverse.client.inspection.qif import qif_text
from traverse.client.inspection.results import inspected
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.measured_points.touch_errors import shared_by_points
from traverse.strict_toml.reader import parse_strict

IN = {"q": "http://qifstandards.org/xsd/qif3"}


@pytest.fixture(scope="module")
def inspection():
    points, _ = touched_points()
    shared_mm = shared_by_points(points, ARM, read_arm(ARM))
    shared = {p.id: mm for p, mm in zip(points, shared_mm, strict=True)}
    return inspected(parse_strict(PLAN, "plan", Plan), points, shared)


@pytest.fixture(scope="module")
def root(inspection):
    return etree.fromstring(qif_text(inspection).encode())


def text(element, path):
    return element.findtext(path, namespaces=IN)


def measured(root, tag, name):
    every = root.iterfind(f".//q:{tag}FeatureMeasurement", IN)
    (feature,) = (e for e in every if text(e, "q:FeatureName") == name)
    return feature


def test_a_feature_has_its_figures_with_standard_uncertainties(root, inspection):
    results = {feature.name: feature for feature in inspection.features}
    hole = measured(root, "Circle", "hole a")
    figures = {figure.name: figure for figure in results["hole a"].figures}
    diameter = hole.find("q:Diameter", IN)
    assert float(diameter.text) == figures["diameter"].value
    half_u = 0.5 * figures["diameter"].expanded
    assert float(diameter.get("combinedUncertainty")) == pytest.approx(half_u)
    place = hole.find("q:Location", IN)
    np.testing.assert_array_equal(
        np.array(place.text.split(), float), results["hole a"].place_mm
    )
    assert float(place.get("xCombinedUncertainty")) > 0.0
    assert float(text(hole, "q:Form")) == figures["form"].value
    cone = measured(root, "Cone", "cone")
    (angle,) = (f for f in results["cone"].figures if f.name == "angle")
    assert float(text(cone, "q:FullAngle")) == pytest.approx(np.deg2rad(angle.value))
    assert text(cone, "q:Axis/q:Direction")


def test_a_figure_with_limits_is_a_characteristic_with_its_status(root, inspection):
    decided = [
        (feature, figure)
        for feature in inspection.features
        for figure in feature.figures
        if figure.conformity is not None
    ]
    measurements = root.find(".//q:CharacteristicMeasurements", IN)
    by_id = {element.get("id"): element for element in root.iterfind(".//*[@id]")}
    names = {}
    for measurement in measurements:
        item = by_id[text(measurement, "q:CharacteristicItemId")]
        names[text(item, "q:Name")] = measurement, item
    assert len(decided) >= 3
    for feature, figure in decided:
        measurement, item = names[f"{feature.name} {figure.name}"]
        nominal = by_id[text(item, "q:CharacteristicNominalId")]
        definition = by_id[text(nominal, "q:CharacteristicDefinitionId")]
        unit = np.deg2rad(1.0) if figure.unit == "deg" else 1.0
        for element, path, value in (
            (measurement, "q:Value", figure.value),
            (nominal, "q:TargetValue", figure.nominal),
            (definition, "q:Tolerance/q:MinValue", figure.lower),
            (definition, "q:Tolerance/q:MaxValue", figure.upper),
        ):
            assert float(text(element, path)) == pytest.approx(unit * value)
        assert text(measurement, "q:Status/q:CharacteristicStatusEnum") == "PASS"
    pitch, _ = names["pitch distance"]
    of = [
        by_id[each.text] for each in pitch.iterfind("q:FeatureMeasurementIds/q:Id", IN)
    ]
    assert [text(each, "q:FeatureName") for each in of] == ["hole a", "hole b"]


def test_what_is_not_judged_or_not_measured_is_no_pass(inspection):
    points, _ = touched_points()
    some = [p for p in points if p.label.feature != "hole b"]
    plan = parse_strict(PLAN, "plan", Plan)
    root = etree.fromstring(qif_text(inspected(plan, some, "no arm file")).encode())
    statuses = {e.text for e in root.iterfind(".//q:CharacteristicStatusEnum", IN)}
    assert statuses == {"NOT_ANALYZED"}
    assert root.findtext(".//q:InspectionStatusEnum", namespaces=IN) == "UNKNOWN"
    assert root.find(".//q:Diameter", IN).get("combinedUncertainty") is None
    nothing = etree.fromstring(qif_text(inspected(plan, [], "no points")).encode())
    assert nothing.find(".//q:MeasuredFeatures", IN) is None


@needs_schemas
def test_it_keeps_to_the_official_schema(inspection):
    check_schema(qif_text(inspection).encode(), Path("features.qif"), SCHEMAS)
