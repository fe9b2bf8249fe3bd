import json

import pytest
from lxml import etree

from tests.docs.pages import CHECKOUT
from tests.official_schemas import SCHEMAS, needs_schemas
from tests.protocol.message_examples import POINT
from tests.running import invoke
from traverse.cli.common.qif_check import SCHEMA, check_schema
from traverse.kinematics.arm_file.arm import arm_digest, read_arm
from traverse.protocol.encoding import encode
from traverse.simulator.campaigns import NoiseTable, write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

ARM = CHECKOUT / "cli" / "demo_data" / "arm.toml"
Q = "{http://qifstandards.org/xsd/qif3}"
NOT_CHECKED = "not checked against the schema (no schemas folder given)"
DEVICE = [
    "Name",
    "Attributes",
    "NumberOfJoints",
    "MaxMeasuringDistance",
    "ProbeTipDiameter",
]
SPAT = [
    f"{name}{zone}"
    for name in ("MaxDeviationFromAverage", "TwiceStandardDeviation")
    for zone in ("Near", "Far", "Middle")
]


def run(*arguments, status=0):
    environment = {"TRAVERSE_SCHEMAS": ""}
    return invoke(*arguments, env=environment, status=status)


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    folder, arm = tmp_path_factory.mktemp("qif"), read_arm(ARM)
    for standard in ("iso10360-12", "asme-b89.4.22"):
        noise = NoiseTable(encoder_rad=2e-6, contact_mm=0.003)
        poses = acceptance_poses(arm, standard, 1, noise=noise)
        write_campaign(folder / "campaign", drawn_acceptance(poses, 1), arm)
        words = ("--standard", standard, "--arm", ARM, "--out", folder / standard)
        run("verify", folder / "campaign", *words, status=1)
        (folder / "campaign" / "campaign.toml").unlink()
    return folder


def device_of(path):
    root = etree.parse(path).getroot()
    assert [child.tag for child in root] == [
        Q + name for name in ("QPId", "Header", "FileUnits", "MeasurementResources")
    ]
    return root.find(f".//{Q}AACMM")


def names_of(element):
    return [child.tag.removeprefix(Q) for child in element]


def test_arm_alone_is_written_from_its_file(tmp_path):
    ran = run("arm", "to-qif", ARM, "--out", tmp_path / "arm.qif")
    assert NOT_CHECKED in ran.output
    device, arm = device_of(tmp_path / "arm.qif"), read_arm(ARM)
    assert names_of(device) == DEVICE
    assert device.findtext(f"{Q}NumberOfJoints") == str(len(arm.joints))
    assert float(device.findtext(f"{Q}ProbeTipDiameter")) == 2 * arm.probe.radius_mm
    attributes = {
        attribute.get("name"): attribute.get("value") for attribute in device[1]
    }
    assert attributes["arm_digest"] == arm_digest(arm)
    links = [float(text) for text in attributes["link_mm"].split()]
    assert links == pytest.approx(
        [sum(part**2 for part in joint.link_mm) ** 0.5 for joint in arm.joints]
    )


@pytest.mark.slow
def test_b89_of_a_verification(verified, tmp_path):
    out, folder = tmp_path / "arm.qif", verified / "asme-b89.4.22"
    words = ("--out", out, "--verification", folder, "--json")
    ran = run("arm", "to-qif", ARM, *words)
    report = json.loads(ran.stdout)
    assert [entry["test"] for entry in report["tests"]] == ["AACMMB89Test"]
    device = device_of(out)
    assert names_of(device)[-1] == "Accuracies"
    (accuracy,) = device[-1]
    assert names_of(accuracy) == [
        "EnvironmentalRange",
        "AACMMB89Test",
        "AccuracySource",
    ]
    spat, volume = accuracy[1]
    assert names_of(spat) == SPAT
    values = json.loads((folder / "certificate.json").read_text())
    figures = {figure["key"]: figure for figure in values["figures"]}
    parts = {part["name"]: part["value_mm"] for part in figures["spat_max"]["parts"]}
    stated = dict(zip(SPAT, (float(deviation.text) for deviation in spat), strict=True))
    for zone in ("near", "far", "middle"):
        assert stated[f"MaxDeviationFromAverage{zone.title()}"] == parts[zone]
    assert max(list(stated.values())[3:]) == figures["spat_2s"]["value_mm"]
    errors = [float(error.text) for error in volume[0]]
    assert errors == [figure["error_mm"] for figure in values["lengths"]]
    assert volume[0].get("n") == "20"
    assert values["digest"]["digest"] in accuracy[2][0].text
    # Nothing was stated: no verdict goes with the figures.
    assert accuracy[2][0].text.startswith("Figures only: not a certificate: ASME")
    attributes = {each.get("name"): each.get("value") for each in device[1]}
    assert "serial_number of arm.toml" in attributes["statements_missing"]


def test_iso_10360_of_a_verification(verified, tmp_path):
    out, folder = tmp_path / "arm.qif", verified / "iso10360-12"
    run("arm", "to-qif", ARM, "--out", out, "--verification", folder)
    values = json.loads((folder / "certificate.json").read_text())
    figures = {figure["key"]: figure["value_mm"] for figure in values["figures"]}
    (accuracy,) = device_of(out)[-1]
    (error,) = accuracy.find(f"{Q}AACMMISO10360Test")
    assert error.tag == f"{Q}MaxErrorConstant"
    assert float(error.text) == abs(figures["e_uni"])


def test_altered_verification_and_another_arm_are_refused(verified, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(ARM.read_text().replace('name = "demo-7"', 'name = "demo-8"'))
    folder, out = verified / "iso10360-12", tmp_path / "arm.qif"
    words = ("--out", out, "--verification", folder)
    ran = run("arm", "to-qif", other, *words, status=2)
    assert "another arm" in ran.output
    file = folder / "certificate.json"
    text = file.read_text()
    file.write_text(text.replace('"value_mm": 0', '"value_mm": 1', 1))
    ran = run("arm", "to-qif", ARM, *words, status=2)
    file.write_text(text)
    assert "altered" in ran.output
    assert not out.exists()


@pytest.mark.parametrize("name", ["arm", "points"])
def test_folder_of_schemas_is_used_or_refused(name, tmp_path):
    source = tmp_path / "points.jsonl"
    source.write_bytes(encode(POINT, "json") + b"\n")
    command = {
        "arm": ("arm", "to-qif", ARM),
        "points": ("export", source, "--to", "qif"),
    }[name]
    words = ("--out", tmp_path / "out.qif", "--force", "--schemas", tmp_path)
    assert NOT_CHECKED in run(*command, *words[:-2]).output
    (tmp_path / "out.qif").unlink()
    for schema, status, message in (
        (None, 2, "schema that can be used"),
        ("<not xml", 2, "schema that can be used"),
        ("Another", 2, "schema: line 2"),
        ("QIFDocument", 0, "keeps to"),
    ):
        assert not (tmp_path / "out.qif").exists()
        if schema is not None:
            (tmp_path / SCHEMA).write_text(
                '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" '
                'targetNamespace="http://qifstandards.org/xsd/qif3">'
                f'<xs:element name="{schema}"/></xs:schema>'
            )
        assert message in run(*command, *words, status=status).output


@needs_schemas
def test_official_schema_accepts_it(verified, tmp_path):
    for standard in ("iso10360-12", "asme-b89.4.22"):
        out, folder = tmp_path / f"{standard}.qif", verified / standard
        run("arm", "to-qif", ARM, "--out", out, "--verification", folder)
        check_schema(out.read_bytes(), out, SCHEMAS)
