"""A certificate states what its evidence says; read back by another XML library."""

import csv
import json
import math
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.lab.certificates.made import LABORATORY, Issued
from tests.official_schemas import SCHEMAS, needs_dcc_schema
from tests.results import ARM
from tests.running import invoke
from tests.simulator.effects.examples import spec_of
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.laboratory import Laboratory
from traverse.lab.certificates.certificate import (
    certify,
    checked_certificate,
)
from traverse.lab.certificates.evidence import (
    UNITS,
    add_data,
    certificate_text,
    quantity,
)
from traverse.lab.certificates.signature import SigningKey
from traverse.lab.certificates.xml import indented, read_xml, schema_problems
from traverse.lab.outcomes.acceptance import (
    VERDICT_WORDS,
    AcceptanceEvidence,
    DecidedFigure,
    acceptance_outcome,
)
from traverse.lab.report.provenance import read_sums, sums_of, write_sums
from traverse.simulator.campaigns import (
    NoiseTable,
    Points,
    draw_noise,
    make_poses,
    write_campaign,
)
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


def said(element: ElementTree.Element, path: str) -> list[str]:
    return [node.text or "" for node in element.findall(path, NAMES)]


def results(folder: Path) -> dict[str, ElementTree.Element]:
    root = ElementTree.parse(folder / "dcc.xml").getroot()
    nodes = root.findall(".//dcc:result", NAMES)
    return {said(node, "dcc:name/dcc:content")[0]: node for node in nodes}


def test_figures_of_a_verification_are_those_of_its_values(signed_verification):
    values = json.loads((signed_verification / "certificate.json").read_text())
    by_name = results(signed_verification)
    assert set(by_name) == {figure["name"] for figure in values["figures"]}
    for figure in values["figures"]:
        result = by_name[figure["name"]]
        stated, limit = said(result, ".//si:value")
        (expanded,) = said(result, ".//si:valueExpandedMU")
        decimals = len(expanded.partition(".")[2])
        assert float(expanded) == round(figure["expanded_uncertainty_mm"], decimals)
        assert len(expanded.replace(".", "").lstrip("0")) == 2
        assert stated == f"{figure['value_mm']:.{decimals}f}"
        assert limit == f"{figure['limit_mm']:.4f}"
        assert said(result, ".//si:coverageFactor") == ["2"]
        assert said(result, ".//si:coverageProbability") == ["0.9545"]
        assert said(result, ".//si:unit") == [r"\milli\metre"] * 2
        assert said(result, ".//dcc:conformity") == ["pass"]


def test_who_when_what_and_the_digests_of_the_data(signed_verification):
    root = ElementTree.parse(signed_verification / "dcc.xml").getroot()
    core = "dcc:administrativeData/dcc:coreData/dcc:"
    assert root.get("schemaVersion") == "3.3.0"
    assert said(root, f"{core}uniqueIdentifier") == ["2026-0417"]
    assert said(root, f"{core}beginPerformanceDate") == ["2026-11-20"]
    assert said(root, f"{core}issueDate") == ["2026-11-23"]
    texts = said(root, ".//dcc:content")
    for text in (
        *("Example & Daughters <calibration>", "Łódź Arms", "M. Curie"),
        *("R-P21, ball of ruby", "humidity of the air", "time of warming up"),
    ):
        assert text in texts
    assert "SN 7" in said(root, ".//dcc:identification/dcc:value")
    data = "dcc:measurementResults/dcc:measurementResult/dcc:measurementMetaData/"
    named = dict(
        zip(
            said(root, f"{data}dcc:metaData/dcc:name/dcc:content"),
            said(root, f"{data}dcc:metaData/dcc:reference"),
            strict=True,
        )
    )
    sums = (signed_verification / "SHA256SUMS").read_text().splitlines()
    for line in sums:
        digest, name = line.split("  ")
        if name != "dcc.xml":
            assert named.pop(name) == f"sha256:{digest}"
    assert named == {}


def test_parameters_of_an_identification(signed_identification):
    values = json.loads((signed_identification / "identification.json").read_text())
    of_certificate = results(signed_identification)
    for entry in values["parameters"]:
        parameter = of_certificate[entry["name"]]
        (stated,) = said(parameter, ".//si:value")
        (expanded,) = said(parameter, ".//si:valueExpandedMU")
        assert math.isclose(
            float(stated), entry["value"], abs_tol=0.01 * entry["std"] * 20
        )
        assert math.isclose(float(expanded), 2.0 * entry["std"], rel_tol=0.06)
        assert said(parameter, ".//si:unit") == [UNITS[entry["unit"]]]
    bar = values["artefacts"]["bar"]["distance_mm"]
    (stated,) = said(of_certificate["bar: distance"], ".//si:value")
    assert math.isclose(float(stated), bar["value"], abs_tol=bar["std"])
    root = ElementTree.parse(signed_identification / "dcc.xml").getroot()
    assert said(root, ".//dcc:conformity") == []


def with_a_second_tool(poses: Path, tool: str) -> None:
    """Give a tool to every other pose, and turn the last orientation."""
    with poses.open(newline="") as file:
        rows = list(csv.reader(file))
    w, x = (rows[0].index(f"orientation_{part}") for part in "wx")
    rows[-1][w], rows[-1][x] = rows[-1][x], rows[-1][w]
    named = [[*row, tool if index % 2 else ""] for index, row in enumerate(rows[1:])]
    with poses.open("w", newline="") as file:
        csv.writer(file).writerows([[*rows[0], "tool"], *named])


@pytest.mark.slow
def test_an_identification_with_tools_and_orientations(laboratory, signer, tmp_path):
    tracker = Points(
        id="tracker", n_poses=90, n_points=90, size_mm=450.0, orientations=True
    )
    noise = NoiseTable(encoder_rad=5e-6, contact_mm=0.02, orientation_rad=5e-5)
    poses = make_poses(read_arm(ARM), spec_of(tracker), 3)
    campaign, out = tmp_path / "campaign", tmp_path / "results"
    write_campaign(campaign, draw_noise(poses, 1, noise), read_arm(ARM))
    file = campaign / "campaign.toml"
    file.write_text(file.read_text() + '\n[[tools]]\nname = "second"\n')
    with_a_second_tool(campaign / "poses.csv", "second")
    invoke("identify", campaign, "--arm", ARM, "--out", out)
    add_data(out, campaign, ARM)
    certify(out, laboratory, SigningKey(signer.key, signer.certificate))
    root = ElementTree.parse(out / "dcc.xml").getroot()
    statements = said(root, ".//dcc:statement/dcc:declaration/dcc:content")
    assert "89 used, 1 left out without their positions" in statements
    assert not any("as given" in statement for statement in statements)
    assert {f"tool.second.{axis}" for axis in "xyz"} <= set(results(out))


@pytest.mark.parametrize(
    ("value", "expanded", "texts"),
    [
        (0.00263, 0.00101, ("0.0026", "0.0010")),
        (-1.23456, 0.0349, ("-1.235", "0.035")),
        (799.99996, 0.5, ("800.00", "0.50")),
        (12.5, 123.0, ("12", "123")),
        (3.1e-5, 4.44e-7, ("0.00003100", "0.00000044")),
        (0.12345678, None, ("0.1235", "")),
        (0.12345678, 0.0, ("0.1235", "")),
    ],
)
def test_two_digits_of_an_uncertainty(value, expanded, texts):
    stated = quantity(value, "mm", expanded)
    assert (stated["value"], stated["expanded"]) == texts


def figure(name: str, verdict: str | None, **more: object) -> dict[str, object]:
    empty = {"definition": "d", "confirm": "", "remarks": [], "rule": "r"}
    numbers = {"value_mm": 0.01, "expanded_uncertainty_mm": 0.002, "limit_mm": 0.05}
    numbers["coverage_factor"] = 2.0
    empty["decision"] = VERDICT_WORDS[verdict]
    return {"name": name, "verdict": verdict, **empty, **numbers, **more}


def document(values: dict[str, object], laboratory: Path) -> ElementTree.Element:
    stated = {
        "laboratory": read_strict(laboratory, Laboratory),
        "issued": "",
        "files": {},
    }
    about = values["administration"], values["arm"]["digest"]
    text = certificate_text("verification", values, *about, **stated)
    return ElementTree.fromstring(text)


def conformity(element: ElementTree.Element) -> str | None:
    return element.findtext("dcc:conformity", None, NAMES)


def test_nothing_passes_that_is_not_accepted(signed_verification, laboratory):
    def conformities(values, *figures, missing=()) -> list[str | None]:
        decided = [
            DecidedFigure(each["name"], 0.01, 0.05, each["verdict"], ())
            for each in figures
        ]
        evidence = AcceptanceEvidence(decided, [gap["name"] for gap in missing])
        changed = {**values, "figures": list(figures), "missing": list(missing)}
        changed["verdict"] = acceptance_outcome(evidence).verdict
        root = document(changed, laboratory)
        (overall,) = [
            node
            for node in root.findall(".//dcc:statement", NAMES)
            if said(node, "dcc:name/dcc:content") == ["Conformity"]
        ]
        each = [
            node.find(
                "dcc:data/dcc:quantity/dcc:measurementMetaData/dcc:metaData", NAMES
            )
            for node in root.findall(".//dcc:result", NAMES)
        ]
        stated = [None if node is None else conformity(node) for node in each]
        return [conformity(overall), *stated]

    values = json.loads((signed_verification / "certificate.json").read_text())
    good, bad = figure("a", "accept"), figure("b", "reject")
    between, open_ = figure("c", "neither"), figure("d", "undecided")
    no_limit = figure("e", None, limit_mm=None)
    gap = {"name": "E_UNI", "what": ["x"]}
    assert conformities(values, good) == ["pass", "pass"]
    assert conformities(values, good, bad) == ["fail", "pass", "fail"]
    assert conformities(values, good, between) == [None, "pass", "noPass"]
    assert conformities(values, good, open_) == [None, "pass", None]
    assert conformities(values, good, no_limit) == [None, "pass", None]
    assert conformities(values, good, missing=[gap]) == [None, "pass"]
    with pytest.raises(ValueError, match="no figure"):
        conformities(values, missing=[gap])


def test_what_was_not_stated_stands_in_place_of_a_verdict(verified, laboratory):
    values = json.loads((verified / "certificate.json").read_text())
    lacking = {"code": "place", "text": "place", "where": "w", "names": [""]}
    values["statements"]["absent"] = [lacking]
    values |= {"verdict": "withheld", "conclusion": "Figures only: not a certificate"}
    values["sentences"] = ["Missing: place (w)."]
    values["figures"] = [figure("a", "withheld")]
    root = document(values, laboratory)
    assert root.findall(".//dcc:conformity", NAMES) == []
    texts = said(root, ".//dcc:content")
    assert "Missing: place (w)." in texts
    assert any(text.startswith("Figures only: not a certificate: V") for text in texts)
    assert not any("accepted" in text for text in texts)


def test_without_a_key_nothing_is_signed_and_the_check_says_so(
    verified, laboratory, signer, tmp_path
):
    folder = shutil.copytree(verified, tmp_path / "copy")
    certify(folder, laboratory, None)
    checked = checked_certificate(folder, ())
    assert checked.problems == ()
    assert "is not signed" in checked.notes[0]
    checked = checked_certificate(folder, [signer.certificate])
    assert "is not signed" in checked.problems[0]


def test_a_certificate_needs_the_date_of_the_measurement(
    verified, laboratory, tmp_path
):
    folder = shutil.copytree(verified, tmp_path / "copy")
    values = json.loads((folder / "certificate.json").read_text())
    for end in ("from", "to"):
        values["administration"][f"measured_{end}_utc"] = None
    with pytest.raises(ValueError, match="give start_utc in campaign"):
        document(values, laboratory)


@pytest.mark.slow
def test_figures_that_do_not_follow_are_not_certified(
    signed_identification, laboratory, signer, tmp_path
):
    folder = shutil.copytree(signed_identification, tmp_path / "copy")
    path = folder / "arm.toml"
    arm = path.read_text()
    line = next(line for line in arm.splitlines() if line.startswith("link_mm"))
    first = line.partition("[")[2].partition(",")[0]
    longer = line.replace(first, repr(float(first) + 0.01), 1)
    path.write_text(arm.replace(line, longer, 1))
    key = SigningKey(signer.key, signer.certificate)
    with pytest.raises(FileError, match=r"arm\.toml was altered: its digest"):
        certify(folder, laboratory, key)
    write_sums(folder, sums_of(folder, read_sums(folder)))
    with pytest.raises(FileError, match=r"arm.toml: joints\[J\d\]"):
        certify(folder, laboratory, key)
    path.write_text(arm)
    write_sums(folder, sums_of(folder, read_sums(folder)))
    certify(folder, laboratory, key)
    data = folder / "data" / "poses.csv"
    data.write_text(data.read_text().replace("cone-1", "cone-2", 1))
    write_sums(folder, sums_of(folder, read_sums(folder)))
    with pytest.raises(FileError, match="is not the one that was identified from"):
        certify(folder, laboratory, key)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('country = "DE"', 'country = "Germany"', "laboratory.country"),
        ('number = "2026-0417"', 'number = " "', "number"),
        ('number = "2026-0417"', 'number = "TBD"', "number"),
        ("[[persons]]", "[[people]]", "persons"),
        ("issued = 2026-11-23", 'issued = "today"', "issued"),
        ('role = "head"', 'rôle = "head"', "file"),
    ],
)
def test_the_laboratorys_file_is_read_strictly(tmp_path, old, new, message):
    path = tmp_path / "laboratory.toml"
    path.write_text(LABORATORY.replace(old, new, 1), "utf-8")
    with pytest.raises(FileError) as refused:
        read_strict(path, Laboratory)
    assert str(path) in str(refused.value)
    assert message == "file" or message in str(refused.value)


def test_untrusted_xml_is_refused(tmp_path):
    bomb = b'<!DOCTYPE a [<!ENTITY b "x"><!ENTITY c "&b;&b;">]><a>&c;</a>'
    outside = b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>'
    for content in (bomb, outside):
        with pytest.raises(FileError, match="DOCTYPE"):
            read_xml(content, "dcc.xml")
    for content in (b"", b"<a>", b"\xff", b"<a></b>"):
        with pytest.raises(FileError, match="is not XML"):
            read_xml(content, "dcc.xml")
    with pytest.raises(FileError, match="a character that XML does not have"):
        indented("<a>\x00</a>", "dcc.xml")


def test_schema_of_a_folder_wherever_its_imports_come_from(
    signed_verification, tmp_path
):
    """The standard's schema imports by addresses; no network is asked."""
    packaged = Path(schema_problems.__code__.co_filename).parent / "schemas"
    text = (packaged / "dcc.xsd").read_text()
    moved = text.replace('"si.xsd"', '"https://ptb.example/si/v2/SI_Format.xsd"')
    assert moved != text
    (tmp_path / "dcc.xsd").write_text(moved)
    root = read_xml((signed_verification / "dcc.xml").read_bytes(), "dcc.xml")
    with pytest.raises(FileError, match="no schema that can be used"):
        list(schema_problems(root, tmp_path))
    shutil.copy(packaged / "si.xsd", tmp_path / "SI_Format.xsd")
    assert list(schema_problems(root, tmp_path)) == []
    core = root.find(".//{*}uniqueIdentifier")
    assert core is not None
    core.text = ""
    (problem,) = list(schema_problems(root, None))
    assert "uniqueIdentifier" in problem


@needs_dcc_schema
def test_valid_by_the_standards_own_schema(signed_verification):
    root = read_xml((signed_verification / "dcc.xml").read_bytes(), "dcc.xml")
    assert list(schema_problems(root, SCHEMAS)) == []


@pytest.mark.parametrize(
    ("day", "message"),
    [("2020-01-01", "before the last touch"), ("2999-01-01", "which is to come")],
)
def test_no_issue_before_the_last_touch_or_in_the_future(
    verified, tmp_path, day, message
):
    folder = shutil.copytree(verified, tmp_path / "copy")
    file = tmp_path / "laboratory.toml"
    file.write_text(LABORATORY.replace("2026-11-23", day), "utf-8")
    with pytest.raises(FileError, match=f"issued is {day}, {message}"):
        certify(folder, file, None)


def test_every_field_of_a_laboratory_is_stated(verified, laboratory, tmp_path):
    folder = shutil.copytree(verified, tmp_path / "copy")
    more = LABORATORY.replace(
        "issued =", 'replaces = "2025-1"\nperformed_at = "customer"\nissued ='
    ).replace(
        'code = "D-K-00000-01-00"',
        'code = "D-K-1"\nemail = "a@b.example"\nphone = "+49 1"\npost_code = "38116"',
    )
    more += 'model = "M1"\n'
    path = tmp_path / "laboratory.toml"
    path.write_text(more, "utf-8")
    certify(folder, path, None)
    assert checked_certificate(folder, ()).problems == ()
    text = (folder / "dcc.xml").read_text("utf-8")
    for stated in ("2025-1", "customer", "a@b.example", "+49 1", "38116", "M1"):
        assert f">{stated}<" in text


def test_an_early_signer_and_one_of_another_day(
    verified, laboratory, tmp_path, signer: Issued
):
    folder = shutil.copytree(verified, tmp_path / "copy")
    certify(folder, laboratory, SigningKey(signer.key, signer.certificate))
    checked = checked_certificate(folder, [signer.certificate])
    assert checked.problems == ()
    assert "who is trusted" in checked.notes[0]
