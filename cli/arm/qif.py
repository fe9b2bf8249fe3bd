"""QIF 3.0 `MeasurementResources`: an arm as AACMM, with the tests of a verification.

A test is written where a certificate holds all that the schema wants of it. The
effective diameter (its average diameter) and AACMMPointAccuracyTest (of places, over
the whole volume) are not among the figures of a verification, so neither is written.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from traverse.cli.arm.summary import arm_summary
from traverse.client.exports.qif import (
    QifDocument,
    add_attributes,
    decimal_text,
    text_element,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.strict_toml.files import json_of

_ZONES = ("near", "far", "middle")  # in the order of the schema
_N_BARS = 20
_LENGTHS = ("e_uni", "e_bi")


def qif_of_arm(arm: Arm, verification: Path | None) -> tuple[bytes, dict[str, Any]]:
    """Write an arm with the tests of a verification; return also a report.

    Args:
        verification: Folder of `traverse verify --out`, or certificate.json in it; it
            is checked as `traverse verify --check` does.

    Raises:
        ValueError: The verification is of another arm, was altered, or a text cannot be
            written.
        FileError: It is no certificate.
    """
    summary = arm_summary(arm)
    values = {} if verification is None else _checked(verification, summary["digest"])
    document = QifDocument()
    resources = SubElement(document.root, "MeasurementResources")
    devices = SubElement(resources, "MeasurementDevices", n="1")
    device = document.identified(devices, "AACMM")
    text_element(device, "Name", " ".join(arm.name.split()))
    if serial := values.get("administration", {}).get("arm_serial_number"):
        text_element(device, "SerialNumber", str(serial))
    joints = summary["joints"]
    add_attributes(
        device,
        {
            "arm_digest": summary["digest"],
            "joints": " ".join(joint["name"] for joint in joints),
            "link_mm": " ".join(repr(joint["link_mm"]) for joint in joints),
            "verification": values.get("conclusion"),
            "statements_missing": _absent(values),
            **_other_figures(values),
        },
    )
    text_element(device, "NumberOfJoints", str(len(joints)))
    _length(device, "MaxMeasuringDistance", summary["reach_mm"])
    _length(device, "ProbeTipDiameter", 2.0 * arm.probe.radius_mm)
    tests: dict[str, Element] = {}
    for tool in dict.fromkeys(
        figure.get("tool") for figure in values.get("figures", ())
    ):
        tests |= _tests(values, tool)
    if tests:
        accuracies = SubElement(device, "Accuracies", n=str(len(tests)))
        for title, test in tests.items():
            _add_accuracy(accuracies, values, title, test)
    report = {
        "arm": arm.name,
        "joints": len(joints),
        "tests": [{"test": test.tag, "of": title} for title, test in tests.items()],
    }
    return document.content(), report


# Keys of figures that a test of the schema holds.
_OF_TESTS = ("spat_max", "spat_2s", "volumetric_max", *_LENGTHS)


def _other_figures(values: Mapping[str, Any]) -> dict[str, str]:
    """Write each figure without a test in the schema: value, U, k, and its decision."""
    written = {}
    for figure in values.get("figures", ()):
        if figure["key"] in _OF_TESTS:
            continue
        expanded_mm = figure["expanded_uncertainty_mm"]
        parts = [f"{decimal_text(figure['value_mm'])} mm"]
        if expanded_mm is None:
            parts.append("U not stated")
        else:
            parts.append(f"U = {decimal_text(expanded_mm)} mm")
            parts.append(f"k = {figure['coverage_factor']:.4g}")
        written[figure["name"]] = "; ".join([*parts, figure["decision"]])
    return written


def _absent(values: Mapping[str, Any]) -> str | None:
    """Name the statements that a verdict lacks; None without any."""
    absent = values.get("statements", {}).get("absent", ())
    return "; ".join(f"{each['text']} ({each['where']})" for each in absent) or None


def _checked(verification: Path, digest: str) -> dict[str, Any]:
    from traverse.lab.acceptance.certificate.check import (  # extra `lab`
        CERTIFICATE,
        certificate_problems,
    )

    file = verification / CERTIFICATE if verification.is_dir() else verification
    problems = certificate_problems(file)
    if problems:
        raise ValueError(f"{file}: altered: {'; '.join(problems)}")
    values: dict[str, Any] = json_of(file)
    if values["arm"]["digest"] != digest:
        raise ValueError(f"{file}: is of another arm, or of other values of this arm")
    return values


def _tests(values: Mapping[str, Any], tool: str | None) -> dict[str, Element]:
    measured, lengths = (
        [tested for tested in values[section] if tested.get("tool") == tool]
        for section in ("figures", "lengths")
    )
    figures = {figure["key"]: figure for figure in measured}
    tests_by_title: dict[str, Element] = {}
    parts = {
        key: {part["name"]: part["value_mm"] for part in figure["parts"]}
        for key, figure in figures.items()
    }
    b89 = Element("AACMMB89Test")
    if "spat_max" in parts and "spat_2s" in parts:
        spat = SubElement(b89, "SinglePointArticulationPerformanceTest")
        for key, name in (
            ("spat_max", "MaxDeviationFromAverage"),
            ("spat_2s", "TwiceStandardDeviation"),
        ):
            for zone in _ZONES:
                _length(spat, f"{name}{zone.title()}", parts[key][zone])
    if "volumetric_max" in parts and len(lengths) == _N_BARS:
        volume = SubElement(b89, "VolumetricPerformanceTest")
        errors = SubElement(volume, "DeviationsFromCalibration", n=str(_N_BARS))
        for length in lengths:
            _length(errors, "LinearValue", length["error_mm"])
        two_s_mm = parts["volumetric_max"]["twice the standard deviation"]
        _length(volume, "TwiceStandardDeviation", two_s_mm)
    if len(b89):
        tests_by_title[
            f"{values['title']} with {tool}" if tool else values["title"]
        ] = b89
    for key in _LENGTHS:
        if key in figures:
            test = Element("AACMMISO10360Test")
            _length(test, "MaxErrorConstant", abs(figures[key]["value_mm"]))
            title = f"{values['title']}, {figures[key]['name']}, largest error measured"
            tests_by_title[title] = test
    return tests_by_title


def _add_accuracy(
    parent: Element, values: Mapping[str, Any], title: str, test: Element
) -> None:
    accuracy = SubElement(parent, "AACMMAccuracy")
    administration = values["administration"]
    low, high = (administration[f"temperature_{end}_c"] for end in ("least", "largest"))
    text = "temperature of the arm was not measured"
    if low is not None and high is not None:
        text = f"temperature of the arm {low!r} to {high!r} degrees Celsius"
    text_element(SubElement(accuracy, "EnvironmentalRange"), "Description", text)
    accuracy.append(test)
    digest = values["digest"]["digest"]
    source = SubElement(accuracy, "AccuracySource")
    withheld = f"{values['conclusion']}: " if values["verdict"] == "withheld" else ""
    text_element(source, "OtherAccuracySource", f"{withheld}{title}; digest {digest}")


def _length(parent: Element, name: str, value_mm: float) -> None:
    text_element(parent, name, decimal_text(value_mm))
