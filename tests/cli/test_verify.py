import json
import re
import shutil

import numpy as np
import pypdfium2
import pytest

from tests.docs.pages import CHECKOUT
from tests.lab.acceptance.stated import limits_text, state_all, write_numbered
from tests.lab.uncertain_arm import write_uncertain_arm
from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm, write_arm
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import NoiseTable, write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
    touched_by,
)

ARM = CHECKOUT / "cli" / "demo_data" / "arm.toml"
NOISE = NoiseTable(encoder_rad=2e-6, contact_mm=0.003)
LINKS_MM, AXES_RAD = 0.02, 1e-5
# (3600 + 73 x 150 + 1125 x 8)/3600, with 24 and 257, with 7 and 210.
HOURS = {"iso10360-12": 6.5, "asme-b89.4.22": 2.6, "vdi2617-9": 1.8}
BORROWED = {
    "iso10360-12": "sphere of radius 12.7 mm, bar of length 350, 700, 1040, 1390, "
    "1740 mm, block of length 350, 700, 1040, 1390, 1740 mm",
    "asme-b89.4.22": "sphere of radius 12.7 mm, bar of length 750, 1610 mm",
    "vdi2617-9": "bar of length 750 mm",
}


def run(*arguments, status=0):
    return invoke("verify", *arguments, status=status)


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    folder, arm = tmp_path_factory.mktemp("acceptance"), read_arm(ARM)
    for standard in ("iso10360-12", "asme-b89.4.22", "vdi2617-9"):
        poses = acceptance_poses(arm, standard, 1, noise=NOISE)
        write_campaign(folder / standard, drawn_acceptance(poses, 1), arm)
        state_all(folder / standard)
    write_numbered(ARM, folder / "arm.toml")
    return folder


def limits_file(folder, form_mm=0.0006, **mpe):
    file = folder / "limits.toml"
    text = limits_text(**mpe).replace("form_mm = 0.0006", f"form_mm = {form_mm}")
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("standard", "names"),
    [
        ("iso10360-12", ["P_SIZE", "P_FORM", "L_DIA (5x5)", "E_UNI"]),
        ("asme-b89.4.22", ["effective diameter", "SPAT, largest", "volumetric, 2 RMS"]),
        ("vdi2617-9", ["interim check of length"]),
    ],
)
def test_figures_of_every_standard(campaigns, standard, names, tmp_path):
    limits = limits_file(tmp_path)
    words = ("--standard", standard, "--arm", campaigns / "arm.toml")
    ran = run(campaigns / standard, *words, "--limits", limits, status=1)
    for name in names:
        assert f"\n{name}: " in ran.output
    assert "Complete; no limits given" in ran.output
    assert "confirm against your copy of the standard" in ran.output


def test_a_certificate_is_written_and_checked(campaigns, tmp_path):
    limits = limits_file(
        tmp_path, p_size_mm=0.05, p_form_mm=0.05, l_dia_mm=0.1, e_uni_mm=0.1
    )
    out = tmp_path / "certificate"
    arm = campaigns / "arm.toml"
    arguments = ("--standard", "iso10360-12", "--arm", arm, "--limits", limits)
    ran = run(campaigns / "iso10360-12", *arguments, "--out", out)
    assert "Complete: accepted." in ran.output
    assert "digests agree" in run("--check", out).output
    poses = out / "data" / "poses.csv"
    poses.write_text(poses.read_text().replace("uni-1-1", "uni-1-2", 1))
    checked = run("--check", out, "--json", status=1)
    (problem,) = json.loads(checked.output)["problems"]
    assert "data/poses.csv was changed" in problem


def test_nothing_is_accepted_without_its_uncertainty(campaigns, tmp_path):
    limits = limits_file(tmp_path, 0.0, p_form_mm=0.05, e_uni_mm=0.1)
    words = ("--standard", "iso10360-12", "--arm", campaigns / "arm.toml")
    text = limits.read_text()
    for rule in ("iso14253-1", "simple"):
        limits.write_text(text.replace("[mpe]", f'decision = "{rule}"\n[mpe]'))
        ran = run(campaigns / "iso10360-12", *words, "--limits", limits, status=1)
        assert "U not stated, MPE 0.0500 mm: no decision, for want of" in ran.output
        undecided = "No decision, for want of an uncertainty: P_FORM. Accepted: E_UNI."
        assert undecided in ran.output
        assert "give form_mm in [standards] of the limits" in ran.output
        assert "Without a limit: P_SIZE, L_DIA (5x5)." in ran.output


def test_without_what_a_verdict_rests_on_there_are_figures_only(campaigns, tmp_path):
    limits = limits_file(
        tmp_path, p_size_mm=0.05, p_form_mm=0.05, l_dia_mm=0.1, e_uni_mm=0.1
    )
    campaign = shutil.copytree(campaigns / "iso10360-12", tmp_path / "campaign")
    file, out = campaign / "campaign.toml", tmp_path / "out"
    text = file.read_text()
    for key in ("humidity_percent", "material"):
        text = re.sub(f"^{key} = .*\n", "", text, flags=re.MULTILINE)
    file.write_text(text.replace("2028-05-04", "2026-11-19"))
    words = ("--standard", "iso10360-12", "--arm", ARM, "--limits", limits)
    ran = run(campaign, *words, "--out", out, status=1)
    values = json.loads((out / "certificate.json").read_text())
    assert (values["verdict"], values["state"]) == ("withheld", "doubt")
    assert values["conclusion"] == "Figures only: not a certificate"
    assert {figure["verdict"] for figure in values["figures"]} == {"withheld"}
    absent = {entry["code"]: entry for entry in values["statements"]["absent"]}
    assert list(absent) == [
        *("arm_serial_number", "humidity", "certificate_holds", "expansion")
    ]
    assert absent["certificate_holds"]["names"] == ["sphere KS 25", "points L 1700"]
    missing = "Missing: serial number of the arm (serial_number of arm.toml)."
    page = (out / "certificate.html").read_text()
    with pypdfium2.PdfDocument(out / "certificate.pdf") as document:
        paper = document[0].get_textpage().get_text_bounded().replace("\r\n", " ")
    for printed in (ran.output, page, paper):
        assert "Figures only: not a certificate" in printed
        assert missing in printed
        assert "ccepted" not in printed
    assert "signature" not in paper
    run("--check", out)


def test_what_a_verdict_needs_is_asked_for_before_anything_is_touched(tmp_path):
    out = tmp_path / "plan"
    run("--plan", "vdi2617-9", "--arm", ARM, "--out", out)
    campaign = out / "campaign.toml"
    campaign.write_text(campaign.read_text().replace("EXAMPLE", "K"))
    ran = run(out, "--standard", "vdi2617-9", "--arm", ARM, status=2)
    for option in (
        "a verdict lacks serial number of the arm: give serial_number of arm.toml",
        "a verdict lacks last day of validity of ball bar K bar 1: give "
        "valid_until in [[artefacts]] of campaign.toml",
        "a verdict lacks coefficient of expansion of ball bar K bar 1: give material",
    ):
        assert option in ran.output
    assert "humidity" not in ran.output  # of an interim check it is not required


def test_as_found_as_left_and_the_previous_certificate(campaigns, tmp_path):
    left = campaigns / "arm.toml"
    arm = read_arm(left)
    longer = [joint.link_mm for joint in arm.joints]
    longer[2] = (longer[2][0], longer[2][1], longer[2][2] + 0.03)
    joints = tuple(
        joint.model_copy(update={"link_mm": link_mm})
        for joint, link_mm in zip(arm.joints, longer, strict=True)
    )
    arm_as_found = tmp_path / "found.toml"
    write_arm(arm_as_found, arm.model_copy(update={"joints": joints}))
    words = (campaigns / "vdi2617-9", "--standard", "vdi2617-9", "--arm")
    limits = limits_file(tmp_path, interim_length_mm=0.05)
    before, out = tmp_path / "before", tmp_path / "out"
    by_itself = run(
        *words, arm_as_found, "--limits", limits, "--out", before, "--json", status=None
    )
    (of_found,) = json.loads(by_itself.output)["figures"]
    ran = run(
        *(*words, left, "--limits", limits, "--out", out),
        *("--as-found", arm_as_found, "--previous", before),
    )
    values = json.loads((out / "certificate.json").read_text())
    (figure,) = values["figures"]
    (as_found,), (in_previous,) = (
        values[section]["figures"] for section in ("as_found", "previous")
    )
    assert as_found["value_mm"] == in_previous["value_mm"] == of_found["value_mm"]
    assert abs(figure["value_mm"]) < 0.03 < abs(in_previous["value_mm"])
    change_mm = abs(figure["value_mm"]) - abs(in_previous["value_mm"])
    assert in_previous["change_mm"] == pytest.approx(change_mm)
    expanded_mm = np.hypot(
        figure["expanded_with_arm_mm"], of_found["expanded_with_arm_mm"]
    )
    assert in_previous["expanded_change_mm"] == pytest.approx(expanded_mm)
    assert in_previous["changed"] == (abs(change_mm) > expanded_mm)
    assert f"as found: {of_found['value_mm']:+.4f} mm, as left" in ran.output
    assert "As found, as left, and before" in (out / "certificate.html").read_text()
    run("--check", out)
    # Another standard's certificate, one that was altered, and another arm.
    previous = before / "certificate.json"
    text = previous.read_text()
    for changed, message in (
        (text.replace('"accept"', '"reject"'), "was altered"),
        (text.replace("vdi2617-9", "asme-b89.4.22"), "was altered"),
        ("{}", "is no certificate"),
        ("{", "is not JSON"),
    ):
        previous.write_text(changed)
        ran = run(*words, left, "--previous", before, status=2)
        assert message in ran.output
    arm_as_found.write_text(arm_as_found.read_text().replace("demo-7", "demo-8"))
    ran = run(*words, left, "--as-found", arm_as_found, status=2)
    assert "is of another arm: demo-8 D7-0042" in ran.output


def test_a_limit_exceeded_is_reported_by_the_exit_status(campaigns, tmp_path):
    limits = limits_file(tmp_path, e_uni_mm=0.001)
    ran = run(
        *(campaigns / "iso10360-12", "--standard", "iso10360-12"),
        *("--arm", campaigns / "arm.toml", "--limits", limits, "--json"),
        status=1,
    )
    values = json.loads(ran.output)
    assert (values["schema"], values["verdict"]) == ("traverse/acceptance/1", "reject")


def test_incomplete_data_are_listed(campaigns, tmp_path):
    folder = tmp_path / "part"
    folder.mkdir()
    for name in ("campaign.toml", "poses.csv"):
        text = (campaigns / "iso10360-12" / name).read_text()
        (folder / name).write_text(text)
    lines = (folder / "poses.csv").read_text().splitlines(keepends=True)
    kept = [line for line in lines if ",uni-3-2," not in line and ",left," not in line]
    (folder / "poses.csv").write_text("".join(kept))
    ran = run(folder, "--standard", "iso10360-12", "--arm", ARM, status=1)
    assert "uni-3-2: was not measured" in ran.output
    assert "4 groups" in ran.output
    assert "Incomplete: L_DIA (5x5), E_UNI not computed." in ran.output
    assert "\nP_SIZE: " in ran.output


@pytest.mark.parametrize("standard", ["iso10360-12", "asme-b89.4.22", "vdi2617-9"])
def test_a_plan_is_a_campaign_that_can_be_collected(standard, tmp_path):
    out = tmp_path / "plan"
    ran = run("--plan", standard, "--arm", ARM, "--out", out, "--bidirectional")
    file = read_campaign_file(out / "campaign.toml")
    assert f"{len(file.artefacts)} artefacts" in ran.output
    for path in (out / "plan.toml", out / "campaign.toml"):
        assert path.is_file()
    hours = re.search(r"about ([\d.]+) h with an hour of warming up", ran.output)
    assert float(hours[1]) == HOURS[standard]
    assert f"to borrow: {BORROWED[standard]}\n" in ran.output
    checked = invoke("check", out / "plan.toml")
    assert "valid collection plan" in checked.output
    # Example values do not count until they are replaced.
    ran = run(out, "--standard", standard, "--arm", ARM, status=2)
    assert f"{out / 'campaign.toml'}: " in ran.output
    assert "operator: is 'EXAMPLE'" in ran.output
    for key in ("artefacts.serial_number: of ", " are an example"):
        assert key in ran.output
    text = (out / "campaign.toml").read_text()
    (out / "campaign.toml").write_text(text.replace("EXAMPLE", "K"))
    ran = run(out, "--standard", standard, "--arm", ARM, status=2)
    assert "poses.csv" in ran.output
    repeated = run("--plan", standard, "--arm", ARM, "--out", out, status=2)
    assert "is there already" in repeated.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "DATA missing"),
        ((".", "--standard", "iso"), "no standard 'iso'; there are: iso10360-12"),
        ((".", "--standard", "vdi2617-9"), "--arm missing"),
        (("--plan", "vdi2617-9"), "--plan needs --arm and --out"),
        (("--check", "nowhere"), "cannot be read"),
        (("nowhere", "--standard", "vdi2617-9", "--arm", ARM), "cannot be read"),
    ],
)
def test_what_is_refused(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = run(*arguments, status=2)
    assert message in ran.output


@pytest.fixture(scope="module")
def uncertain_arm(tmp_path_factory):
    """An arm file with its covariance; and a true arm that agrees with it."""
    folder, arm = tmp_path_factory.mktemp("uncertain"), read_arm(ARM)
    write_uncertain_arm(folder, LINKS_MM, AXES_RAD)
    drawn = Deviations(links_mm=LINKS_MM, axes_rad=AXES_RAD, zeros_rad=0.0)
    poses = acceptance_poses(arm, "iso10360-12", 1, noise=NOISE)
    poses = touched_by(poses, true_arm(arm, drawn, 4))
    write_campaign(folder / "campaign", drawn_acceptance(poses, 1), arm)
    return folder


def test_lengths_are_compared_with_what_the_arm_file_predicts(uncertain_arm, tmp_path):
    arm, out = uncertain_arm / "arm.toml", tmp_path / "certificate"
    words = (uncertain_arm / "campaign", "--standard", "iso10360-12", "--arm", arm)
    ran = run(*words, "--out", out, status=1)
    assert "of 105 errors of length lie within U, k = 2, of arm and" in ran.output
    assert "the uncertainty that it states of lengths holds" in ran.output
    values = json.loads((out / "certificate.json").read_text())["predicted_by_arm"]
    assert 90 <= values["inside"] <= 105
    assert 0.7 < values["sigma0"] < 1.3
    assert values["explains"]
    assert len(values["lengths"]) == 105
    assert 'id="predicted"' in (out / "certificate.html").read_text()
    run("--check", out)
    # The statement is computed again, not believed.
    (out / "data" / "arm.cov.npz").unlink()
    assert "data/arm.cov.npz is missing" in run("--check", out, status=1).output


def test_an_arm_worse_than_its_file_says_is_told(uncertain_arm, tmp_path):
    with np.load(uncertain_arm / "arm.cov.npz") as file:
        names, covariance = file["names"], file["covariance"]
    np.savez(tmp_path / "arm.cov.npz", names=names, covariance=covariance / 100.0)
    text = (uncertain_arm / "arm.toml").read_text()
    text = text.partition("covariance_digest")[0]
    (tmp_path / "arm.toml").write_text(text)
    words = (uncertain_arm / "campaign", "--standard", "iso10360-12")
    ran = run(*words, "--arm", tmp_path / "arm.toml", "--json", status=1)
    assert not json.loads(ran.output)["predicted_by_arm"]["explains"]
    ran = run(*words, "--arm", tmp_path / "arm.toml", status=1)
    assert "errors are larger than it states; identify the arm again" in ran.output


def test_why_lengths_are_not_predicted_is_told(uncertain_arm, tmp_path):
    for file in ("campaign.toml", "poses.csv"):
        text = (uncertain_arm / "campaign" / file).read_text()
        (tmp_path / file).write_text(text.replace("contact_mm", "# contact_mm"))
    words = ("--standard", "iso10360-12", "--arm", uncertain_arm / "arm.toml")
    ran = run(tmp_path, *words, status=1)
    assert "states no encoder_rad and contact_mm in [noise]" in ran.output
    assert "Predicted by the arm file" not in ran.output
