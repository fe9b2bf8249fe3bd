"""Features of a part as QIF 3.0 (ISO 23952): what was measured, and what was decided.

A feature has its place, direction, diameter, angle and form, as far as it has them. A
figure with a tolerance, and each distance and angle between features, is a
characteristic: definition, nominal, item and measurement. Angles are radians. Standard
uncertainties are stated where U is known.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from traverse.client.exports.qif import (
    QifDocument,
    add_attributes,
    decimal_text,
    numbers_text,
    text_element,
)
from traverse.client.exports.text import iso_times
from traverse.client.inspection.values import FeatureResult, FigureResult, Inspection
from traverse.kinematics.features.figures import Conformity
from traverse.kinematics.uncertainty.joint_covariance import COVERAGE_FACTOR

_ELEMENTS = ("point", "line", "plane", "circle", "sphere", "cylinder", "cone")
_WITH_AXIS = ("cylinder", "cone")
_STATUS: dict[Conformity | None, str] = {
    "conforming": "PASS",
    "not conforming": "FAIL",
    "undecided": "INDETERMINATE",
    "not judged": "NOT_ANALYZED",
    None: "NOT_ANALYZED",
}
_BETWEEN = {"distance": "DistanceBetween", "angle": "AngleBetween"}
_IN_SPACE = "THREEDIMENSIONAL"


@dataclass(frozen=True, slots=True)
class _Characteristic:
    feature: FeatureResult
    figure: FigureResult

    @property
    def kind(self) -> str:
        figure, feature = self.figure.name, self.feature.kind
        if figure == feature:
            return _BETWEEN[figure]
        if figure == "diameter":
            return "SphericalDiameter" if feature == "sphere" else "Diameter"
        return "Angle" if figure == "angle" else "UserDefinedLinear"

    @property
    def name(self) -> str:
        return f"{self.feature.name} {self.figure.name}"


def qif_text(inspection: Inspection) -> str:
    """Write all features that are measured.

    Raises:
        ValueError: A name has a character that XML does not have.
    """
    document = QifDocument()
    measured = [feature for feature in inspection.features if not feature.problem]
    characteristics = [
        _Characteristic(feature, figure)
        for feature in measured
        for figure in feature.figures
        if figure.conformity is not None or figure.name == feature.kind
    ]
    item_ids = _add_characteristics(document, characteristics)
    results = SubElement(document.root, "Results")
    every = SubElement(results, "MeasurementResultsSet", n="1")
    part = document.identified(every, "MeasurementResults")
    add_attributes(part, _about(inspection))
    placed = [feature for feature in measured if feature.place_mm is not None]
    feature_ids: dict[str, str] = {}
    if placed:
        features = SubElement(part, "MeasuredFeatures", n=str(len(placed)))
        for feature in placed:
            added = _add_feature(document, features, feature, inspection.last_ns)
            feature_ids[feature.name] = added.attrib["id"]
    if characteristics:
        n = str(len(characteristics))
        decided = SubElement(part, "MeasuredCharacteristics")
        decided = SubElement(decided, "CharacteristicMeasurements", n=n)
        for characteristic, item_id in zip(characteristics, item_ids, strict=True):
            names = characteristic.feature.of or (characteristic.feature.name,)
            of_ids = [feature_ids[name] for name in names if name in feature_ids]
            _add_decision(document, decided, characteristic, item_id, of_ids)
    status = SubElement(part, "InspectionStatus")
    text_element(status, "InspectionStatusEnum", _outcome(inspection))
    return document.content().decode()


def _about(inspection: Inspection) -> dict[str, str | None]:
    return {
        "part": inspection.part or None,
        "serial": inspection.serial or None,
        "operator": inspection.operator or None,
        "arm": inspection.arm,
        "arm_digest": inspection.model,
        "coordinates": inspection.system,
        "decided_by": "ISO 14253-1, k = 2",
        "uncertainty_unknown": inspection.uncertainty_unknown or None,
        "left_out": "; ".join(inspection.left_out) or None,
    }


def _outcome(inspection: Inspection) -> str:
    if any(feature.problem for feature in inspection.features):
        return "UNKNOWN"
    match inspection.conformity:
        case "conforming":
            return "PASS"
        case "not conforming":
            return "FAIL"
        case None:
            return "NOT_CALCULATED"
        case _:
            return "UNKNOWN"


def _add_characteristics(
    document: QifDocument, characteristics: Sequence[_Characteristic]
) -> list[str]:
    """Add definitions, nominals and items; return the items' ids."""
    if not characteristics:
        return []
    n = str(len(characteristics))
    standards = Element("StandardsDefinitions", n="1")
    document.root.insert(2, standards)  # between header and units
    standard = document.identified(standards, "Standard")
    organization = SubElement(standard, "Organization")
    text_element(organization, "StandardsOrganizationEnum", "ISO")
    text_element(standard, "Designator", "8015")
    aspects = SubElement(document.root, "Characteristics")
    text_element(aspects, "FormalStandardId", standard.attrib["id"])
    definitions = SubElement(aspects, "CharacteristicDefinitions", n=n)
    nominals = SubElement(aspects, "CharacteristicNominals", n=n)
    items = SubElement(aspects, "CharacteristicItems", n=n)
    item_ids = []
    for each in characteristics:
        tag, figure = f"{each.kind}Characteristic", each.figure
        definition = document.identified(definitions, f"{tag}Definition")
        text_element(definition, "Name", each.name)
        if figure.lower is None or figure.upper is None:
            text_element(definition, "NonTolerance", "MEASURED")
        else:
            tolerance = SubElement(definition, "Tolerance")
            text_element(tolerance, "MaxValue", _value_text(figure, figure.upper))
            text_element(tolerance, "MinValue", _value_text(figure, figure.lower))
            text_element(tolerance, "DefinedAsLimit", "true")
        if each.kind == "UserDefinedLinear":
            text_element(definition, "WhatToMeasure", figure.name)
        nominal = document.identified(nominals, f"{tag}Nominal")
        text_element(nominal, "CharacteristicDefinitionId", definition.attrib["id"])
        if figure.nominal is not None:
            text_element(nominal, "TargetValue", _value_text(figure, figure.nominal))
        if each.kind in _BETWEEN.values():
            text_element(nominal, "AnalysisMode", _IN_SPACE)
        item = document.identified(items, f"{tag}Item")
        text_element(item, "Name", each.name)
        text_element(item, "CharacteristicNominalId", nominal.attrib["id"])
        item_ids.append(item.attrib["id"])
    return item_ids


def _add_feature(
    document: QifDocument, parent: Element, feature: FeatureResult, last_ns: int
) -> Element:
    kind = feature.kind
    if kind not in _ELEMENTS:  # a relation makes points and lines
        kind = "point" if feature.direction is None else "line"
    element = document.identified(parent, f"{kind.capitalize()}FeatureMeasurement")
    doubts = {doubt for touch in feature.touches for doubt in touch.doubts}
    add_attributes(
        element,
        {
            "kind": feature.kind,
            "of": " ".join(feature.of) or None,
            "side": feature.side or None,
            "touches": " ".join(touch.id for touch in feature.touches) or None,
            "flags": " ".join(sorted(doubts)) or None,
        },
    )
    text_element(element, "FeatureName", feature.name)
    (time_utc,) = iso_times([last_ns])
    text_element(element, "TimeStamp", time_utc)
    figures = {figure.name: figure for figure in feature.figures}
    axis = SubElement(element, "Axis") if kind in _WITH_AXIS else element
    place = text_element(
        axis,
        "AxisPoint" if kind in _WITH_AXIS else "Location",
        numbers_text(feature.place_mm or ()),
    )
    for name in "xyz":
        expanded = figures[name].expanded if name in figures else None
        if expanded is not None:
            uncertainty = decimal_text(expanded / COVERAGE_FACTOR)
            place.set(f"{name}CombinedUncertainty", uncertainty)
    if feature.direction is not None and kind not in ("point", "sphere"):
        tag = "Normal" if kind in ("plane", "circle") else "Direction"
        text_element(axis, tag, numbers_text(feature.direction))
    for name, tag in (("diameter", "Diameter"), ("angle", "FullAngle")):
        if name in figures:
            _add_value(element, tag, figures[name])
    if "form" in figures and kind != "point":
        _add_value(element, "Form", figures["form"])
    return element


def _add_decision(
    document: QifDocument,
    parent: Element,
    characteristic: _Characteristic,
    item_id: str,
    of_ids: Sequence[str],
) -> None:
    tag = f"{characteristic.kind}CharacteristicMeasurement"
    element = document.identified(parent, tag)
    status = SubElement(element, "Status")
    decision = _STATUS[characteristic.figure.conformity]
    text_element(status, "CharacteristicStatusEnum", decision)
    text_element(element, "CharacteristicItemId", item_id)
    if of_ids:
        ids = SubElement(element, "FeatureMeasurementIds", n=str(len(of_ids)))
        for feature_id in of_ids:
            text_element(ids, "Id", feature_id)
    _add_value(element, "Value", characteristic.figure)


def _add_value(parent: Element, tag: str, figure: FigureResult) -> None:
    element = text_element(parent, tag, _value_text(figure, figure.value))
    if figure.expanded is not None:
        std = figure.expanded / COVERAGE_FACTOR
        element.set("combinedUncertainty", _value_text(figure, std))


def _value_text(figure: FigureResult, value: float) -> str:
    return decimal_text(math.radians(value) if figure.unit == "deg" else value)
