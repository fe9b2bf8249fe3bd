"""The certificate: what it holds, and what a change to any of it does."""

import json
import shutil
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pypdfium2
import pytest

from tests.docs.pages import CHECKOUT
from tests.lab.acceptance.stated import limits_text, state_all, write_numbered
from tests.lab.report.pages import Page
from traverse.kinematics.arm_file.arm import Identification, read_arm
from traverse.lab.acceptance.administration import administration_of
from traverse.lab.acceptance.certificate.check import certificate_problems
from traverse.lab.acceptance.certificate.comparison import Before
from traverse.lab.acceptance.certificate.digests import digest_values
from traverse.lab.acceptance.certificate.files import write_certificate
from traverse.lab.acceptance.certificate.page import WORDS
from traverse.lab.acceptance.certificate.pdf import certificate_pdf
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.acceptance.limits import NO_LIMITS, Limits, Mpe
from traverse.lab.acceptance.standards import verified
from traverse.lab.acceptance.statements import absent_statements
from traverse.lab.measured_points.reading import files_read, read_measured
from traverse.lab.report.provenance import (
    ReportSource,
    digest_of_files,
    read_sums,
    report_provenance,
    sums_of,
    write_sums,
)
from traverse.simulator.campaigns import write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict

ARM = CHECKOUT / "cli" / "demo_data" / "arm.toml"
LIMITS = limits_text(interim_length_mm=0.05)
TODAY = "2026-11-21"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A simulated interim check, and the certificate of it."""
    folder = tmp_path_factory.mktemp("interim")
    arm_file = write_numbered(ARM, folder / "numbered.toml")
    arm = read_arm(arm_file)
    write_campaign(
        folder, drawn_acceptance(acceptance_poses(arm, "vdi2617-9", 3), 3), arm
    )
    (folder / "limits.toml").write_text(LIMITS)
    limits = read_strict(folder / "limits.toml", Limits)
    state_all(folder)
    measured = read_measured(folder, arm)
    verification = verified([measured], "vdi2617-9", limits)
    files = {path.name: path.read_bytes() for path in files_read(folder)}
    files["arm.toml"] = arm_file.read_bytes()
    files["limits.toml"] = LIMITS.encode()
    when = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
    return SealedCertificate(
        verification,
        arm,
        limits,
        files,
        administration_of([measured], arm, limits),
        report_provenance(
            ReportSource("interim", digest_of_files(files_read(folder))),
            "C. Gauss",
            when,
        ),
    )


@pytest.fixture(scope="module")
def original(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificate")
    write_certificate(made, folder)
    return folder


@pytest.fixture
def written(original, tmp_path):
    """A copy to be changed."""
    return shutil.copytree(original, tmp_path, dirs_exist_ok=True)


@pytest.mark.parametrize(
    ("code", "stated"),
    [
        ("operator", {"operator": "  "}),
        ("place", {"place": "n/a"}),
        ("probe", {"probe": "-"}),
        ("arm_serial_number", {"arm_serial_number": "TBD"}),
        ("dates", {"measured_to_utc": "2026-11-22T08:00:00Z"}),
        ("next_date", {"next_date": "2026-11-20"}),
        ("longest_length", {"measuring_range_mm": 2400.0}),
        ("longest_length", {"measuring_range_mm": 24.0}),
        ("expansion_holds", {"temperature_largest_c": 30.5}),
    ],
)
def test_a_careless_laboratory_gets_no_verdict(made, code, stated):
    complete = replace(made.administration, measuring_range_mm=1000.0)
    assert absent_statements("iso10360-12", complete, TODAY) == ()
    careless = replace(complete, **stated)
    (absent,) = absent_statements("iso10360-12", careless, TODAY)
    assert absent.code == code


@pytest.mark.parametrize(
    ("code", "stated"),
    [
        ("certificate_holds", {"valid_until": "2026-11-19"}),
        ("certificate_holds", {"calibration_date": "2026-11-21"}),
        ("standard_serial_number", {"serial_number": "?"}),
        ("expansion_std", {"expansion_std_per_c": 0.0}),
        ("one_certificate", {"certificate_number": "D-K-9999"}),
    ],
)
def test_a_careless_standard_gives_no_verdict(made, code, stated):
    (bar,) = made.administration.standards
    careless = replace(bar, **stated)
    both = (bar, careless) if code == "one_certificate" else (careless,)
    administration = replace(made.administration, standards=both)
    (absent,) = absent_statements("vdi2617-9", administration, TODAY)
    assert (absent.code, absent.names) == (code, (careless.name,))


def test_permissible_errors_are_not_in_micrometres(made, original):
    measured = read_measured(original / "data", made.arm)
    limits = made.limits.model_copy(update={"mpe": Mpe(interim_length_mm=40)})
    stated = administration_of([measured], made.arm, limits)
    (absent,) = absent_statements("vdi2617-9", stated, TODAY)
    assert absent.subject.endswith("instead of interim_length_mm = 40")


def test_what_was_before_was_not_measured_later(made):
    later = {"measured_to_utc": "2027-01-01T00:00:00Z"}
    previous = {**made.values, "administration": later}
    with pytest.raises(FileError, match="was measured later"):
        _ = replace(made, before=Before(previous=previous)).values


def test_copied_touches_are_no_basis_of_a_verdict(made, original, tmp_path):
    shutil.copytree(original / "data", tmp_path, dirs_exist_ok=True)
    table = tmp_path / "poses.csv"
    head, *rows = table.read_text().splitlines()
    later = [f"{float(time_s) + 5e3},{cells}" for time_s, cells in map(once_cut, rows)]
    table.write_text("\n".join([head, *rows, *later]))
    measured = read_measured(tmp_path, made.arm)
    stated = administration_of([measured], made.arm, made.limits)
    assert stated.copied_touches == len(rows)
    absent = absent_statements("vdi2617-9", stated, TODAY)
    assert [statement.code for statement in absent] == ["touches"]


def once_cut(row):
    return row.split(",", 1)


def test_an_arm_is_not_verified_by_what_it_was_identified_from(made, original):
    measured = read_measured(original / "data", made.arm)
    known = Identification(
        sigma0=1.0,
        redundancy=300,
        campaign_digest=measured.occasion.campaign_digest,
    )
    arm = made.arm.model_copy(update={"identification": known})
    stated = administration_of([measured], arm, made.limits)
    absent = absent_statements("vdi2617-9", stated, TODAY)
    assert [statement.code for statement in absent] == ["independence"]


def test_everything_is_there_and_agrees(made, written):
    names = {
        str(path.relative_to(written)) for path in written.rglob("*") if path.is_file()
    }
    assert names == {
        "SHA256SUMS",
        "certificate.json",
        "certificate.html",
        "certificate.pdf",
        "data/arm.toml",
        "data/campaign.toml",
        "data/limits.toml",
        "data/poses.csv",
    }
    assert certificate_problems(written) == []
    assert certificate_problems(written / "certificate.json") == []
    values = json.loads((written / "certificate.json").read_text())
    assert values == made.values
    assert values["schema"] == "traverse/acceptance/1"
    assert values["verdict"] == "accept"
    assert values["complete"]


def test_page_and_document_say_every_figure(made, written):
    page = (written / "certificate.html").read_text()
    Page(page).check_is_self_contained()
    values = made.values
    for figure in values["figures"]:
        assert figure["name"] in page
        assert f"{figure['value_mm']:+.4f}" in page
        assert figure["confirm"] in page
    assert values["digest"]["digest"] in page
    assert 'download="poses.csv"' in page
    assert "http" not in page
    lines = WORDS.lines("summary", values)
    assert "accepted" in lines[1]
    assert lines[-1] == "Complete: accepted."


def test_the_document_is_typeset_and_has_its_data_attached(made, written):
    with pypdfium2.PdfDocument(written / "certificate.pdf") as document:
        pages = [page.get_textpage().get_text_bounded() for page in document]
        attached = {
            attachment.get_name(): bytes(attachment.get_data())
            for attachment in (
                document.get_attachment(index)
                for index in range(document.count_attachments())
            )
        }
    for number, text in enumerate(pages, 1):
        assert f"page {number} of {len(pages)}" in text
        assert "Verification by VDI/VDE 2617-9" in text
    first = pages[0]
    assert first.index("Accepted") < first.index("Figures")
    assert "a ball bar in 7 positions" not in first
    assert "a ball bar in 7 positions" in pages[1]
    for words in (
        *("2026-11-20 09:00:00 UTC to 2026-11-20", "20.00 °C", "M. Curie"),
        *("Laboratory 2", "KB 0815", "2026-05-04", "D-K-4711", "C. Gauss"),
        *(
            "Serial number of the arm D7-0042",
            "signature",
            made.provenance.campaign.sha256,
        ),
    ):
        assert words in first.replace("\r\n", " ")
    assert attached == {
        **made.files,
        "certificate.json": (written / "certificate.json").read_bytes(),
    }


def test_no_part_of_a_name_vanishes_on_paper_or_turns_the_writing(made, caplog):
    changed = json.loads(json.dumps(made.values))
    changed["administration"]["operator"] = "Ł\x1b[2J\u202eż\u7530"
    document = pypdfium2.PdfDocument(certificate_pdf(changed, {}))
    text = document[0].get_textpage().get_text_bounded()
    document.close()
    assert "Ł\\x1b[2J\\u202eż\\u7530" in text
    assert "missing" not in caplog.text


def test_the_page_says_who_measured_when_with_which_standards(made, written):
    page = (written / "certificate.html").read_text()
    for words in ("M. Curie", "Laboratory 2", "KB 0815", "2026-05-04", "D7-0042"):
        assert f"<td>{words}</td>" in page
    heads = [page.index(f"<h2>{head}") for head in ("Measurement", "Definitions")]
    assert page.index("Accepted") < heads[0] < heads[1]
    # Nobody says who certifies, and under which number.
    assert "Record of a verification" in page


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("data/poses.csv", "check-1", "check-2", "data/poses.csv was changed"),
        ("data/limits.toml", "0.05", "0.06", "data/limits.toml was changed"),
        ("data/arm.toml", "demo-7", "demo-8", "data/arm.toml was changed"),
        ("certificate.json", '"accept"', '"reject"', "the figures were changed"),
        ("certificate.json", '"digest": {', '"more": 1, "digest": {', "were changed"),
    ],
)
def test_every_change_is_seen(written, name, old, new, message):
    change(written / name, old, new)
    assert any(message in problem for problem in certificate_problems(written))


def test_a_file_that_is_gone_is_reported(written):
    (written / "data" / "poses.csv").unlink()
    assert certificate_problems(written) == ["data/poses.csv is missing"]


def test_other_figures_with_new_digests_do_not_follow_from_the_data(made, written):
    # Whoever changes a figure and makes all digests anew is found by computing again.
    (figure,) = made.verification.figures
    values = json.loads((written / "certificate.json").read_text())
    smaller = figure.value_mm / 2
    values["figures"][0]["value_mm"] = smaller
    files = values.pop("digest")["files"]
    values["digest"] = digest_values(values, files)
    (written / "certificate.json").write_text(json.dumps(values))
    (problem,) = certificate_problems(written)
    assert problem.startswith("certificate.json was altered")
    write_sums(written, sums_of(written, read_sums(written)))
    (problem,) = certificate_problems(written)
    assert f"value_mm: the data give {figure.value_mm!r}" in problem


def test_draws_of_another_version_of_numpy_are_not_compared(written):
    def seal(values):
        files = values.pop("digest")["files"]
        values["digest"] = digest_values(values, files)
        (written / "certificate.json").write_text(json.dumps(values))
        write_sums(written, sums_of(written, read_sums(written)))
        return list(certificate_problems(written))

    values = json.loads((written / "certificate.json").read_text())
    values["figures"][0]["monte_carlo"]["standard_mm"] *= 1.01
    (problem,) = seal(values)
    assert "monte_carlo.standard_mm: the data give" in problem
    values["provenance"]["versions"]["numpy"] = "1.0"
    assert seal(values) == []


def test_another_file_is_no_certificate(tmp_path):
    with pytest.raises(FileError, match="cannot be read"):
        certificate_problems(tmp_path)
    (tmp_path / "certificate.json").write_text('{"schema": "other"}')
    with pytest.raises(FileError, match="is no certificate"):
        certificate_problems(tmp_path)


def test_a_table_of_points_gives_the_same_figures(made, tmp_path):
    folder = tmp_path / "points"
    folder.mkdir()
    for name in ("campaign.toml", "poses.csv"):
        (folder / name).write_bytes(made.files[name])
    arm = read_arm(ARM)
    data = read_measured(folder, arm)
    lines = ["id,artefact,feature,x_mm,y_mm,z_mm,temperature_c"]
    for name, touched in data.touched.items():
        for place, feature in zip(touched.places_mm, touched.features, strict=True):
            cells = ",".join(map(repr, place.tolist()))
            lines.append(f"p,{name},{feature},{cells},20.0")
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    again = verified([read_measured(folder, arm)], "vdi2617-9", NO_LIMITS)
    values = [figure.value_mm for figure in again.figures]
    expected = [figure.value_mm for figure in made.verification.figures]
    np.testing.assert_allclose(values, expected, atol=1e-9)
    (folder / "poses.csv").write_text(
        "\n".join([lines[0], "p,chek-1,1,1,2,3,", "p,check-1,1,1,2,x,", ""])
    )
    with pytest.raises(FileError) as refused:
        read_measured(folder, arm)
    assert [p.where for p in refused.value.problems] == [
        "line 2",
        "line 3, column z_mm",
    ]
