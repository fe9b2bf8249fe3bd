"""Acceptance tests of simulated arms that were touched with several tools."""

import json
import re

import numpy as np
import pytest

from tests.docs.pages import CHECKOUT
from tests.lab.acceptance.stated import limits_text, state_all, write_numbered
from tests.lab.acceptance.test_simulated_arms import ARM, poses_of
from tests.lab.certificates.made import LABORATORY
from tests.running import invoke
from traverse.client.exports.qif import decimal_text
from traverse.lab.acceptance.standards import STANDARDS, verified
from traverse.lab.certificates.certificate import certify, checked_certificate
from traverse.lab.measured_points.reading import read_by_tool, read_measured
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import write_campaign
from traverse.simulator.campaigns.acceptance.poses import drawn_acceptance, touched_by
from traverse.strict_toml.problems import FileError

ISO, INTERIM = "iso10360-12", "vdi2617-9"
ARM_FILE = CHECKOUT / "cli" / "demo_data" / "arm.toml"
STAR_MM = (22.0, -6.0, 15.0)
OFF_MM = 0.05


def arm_with(vector_mm):
    return ARM.model_copy(
        update={"probe": ARM.probe.model_copy(update={"vector_mm": vector_mm})}
    )


def single(standard, folder, vector_mm):
    """Touch everything with one tool; the arm file does not know it."""
    truth = true_arm(arm_with(vector_mm), Deviations(), 1)
    # So far away the ball is there after some more steps.
    poses = touched_by(touched_by(poses_of(standard), truth), truth)
    write_campaign(folder, drawn_acceptance(poses, 1), ARM)
    return folder


def table(*, star):
    vector = "" if star is None else f"vector_mm = {list(star)}\n"
    return f'\n[[tools]]\nname = "star"\n{vector}'


def campaign(standard, folder, star=STAR_MM):
    """Touch everything with the arm's own probe and then with another tool."""
    with_own_probe = single(standard, folder / "own", ARM.probe.vector_mm)
    other = single(standard, folder / "other", STAR_MM)
    both = folder / "both"
    both.mkdir()
    text = (with_own_probe / "campaign.toml").read_text()
    (both / "campaign.toml").write_text(text + table(star=star))
    header, *rows = (with_own_probe / "poses.csv").read_text().splitlines()
    lines = [f"{header},tool", *(f"{row}," for row in rows)]
    _, *rows = (other / "poses.csv").read_text().splitlines()
    lines += [f"{row},star" for row in rows]
    (both / "poses.csv").write_text("\n".join(lines) + "\n")
    return both


def figures(standard, folder):
    verification = verified(read_by_tool(folder, ARM), standard)
    assert verification.missing == ()
    return {(figure.tool, figure.key): figure for figure in verification.figures}


def run(*arguments, status=0):
    return invoke("verify", *arguments, status=status)


@pytest.mark.parametrize("standard", STANDARDS)
def test_a_perfect_arm_has_no_errors_with_any_tool(standard, tmp_path):
    by_tool = figures(standard, campaign(standard, tmp_path))
    assert {tool for tool, _ in by_tool} == {"own probe", "star"}
    for (tool, _), figure in by_tool.items():
        assert figure.name.endswith(f" with {tool}")
        assert figure.value_mm == pytest.approx(0.0, abs=1e-6), figure.name


def test_a_wrong_vector_shows_as_an_error_of_that_tool_alone(tmp_path):
    wrong_mm = (STAR_MM[0] + OFF_MM, *STAR_MM[1:])
    by_tool = figures(ISO, campaign(ISO, tmp_path, wrong_mm))
    # Turned about the shank the ball is off by as much to every side.
    assert by_tool["star", "l_dia"].value_mm > OFF_MM
    assert abs(by_tool["star", "e_uni"].value_mm) > OFF_MM
    for key in ("p_size", "p_form", "l_dia", "e_uni"):
        assert by_tool["own probe", key].value_mm == pytest.approx(0.0, abs=1e-6)


def test_figures_are_those_of_touches_with_that_tool_alone(tmp_path):
    wrong_mm = (STAR_MM[0], STAR_MM[1] - OFF_MM, STAR_MM[2])
    by_tool = figures(ISO, campaign(ISO, tmp_path, wrong_mm))
    alone = read_measured(tmp_path / "other", arm_with(wrong_mm))
    for figure in verified([alone], ISO).figures:
        same = by_tool["star", figure.key]
        assert same.value_mm == figure.value_mm
        assert same.parts == figure.parts


def test_a_vector_is_never_estimated(tmp_path):
    folder = campaign(INTERIM, tmp_path, star=None)
    with pytest.raises(FileError, match="it would hide its own error") as refused:
        read_by_tool(folder, ARM)
    assert refused.value.problems[0].where == "tools.star.vector_mm"
    ran = run(folder, "--standard", INTERIM, "--arm", ARM_FILE, status=2)
    assert "give it from the probe library or from another campaign" in ran.output


def test_touches_with_different_tools_do_not_count_together(tmp_path):
    folder = single(INTERIM, tmp_path / "one", ARM.probe.vector_mm)
    header, *rows = (folder / "poses.csv").read_text().splitlines()
    lines = [f"{header},tool"]
    # The last of the seven positions with another tool.
    lines += [f"{row},{'star' if 'check-7' in row else ''}" for row in rows]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text + table(star=STAR_MM))
    ran = run(folder, "--standard", INTERIM, "--arm", ARM_FILE, status=1)
    with_own_probe, star = ran.output.split(
        "interim check of length with star: not computed"
    )
    assert with_own_probe.count("was not measured") == 1
    assert star.count("was not measured") == 6
    assert (
        "Incomplete: interim check of length with own probe, "
        "interim check of length with star not computed."
    ) in ran.output


def test_the_certificate_names_the_tools_and_is_checked(tmp_path):
    folder, out = campaign(INTERIM, tmp_path), tmp_path / "out"
    limits = tmp_path / "limits.toml"
    limits.write_text(
        'schema = "traverse/acceptance-limits/1"\ndecision = "simple"\n'
        "[mpe]\ninterim_length_mm = 0.01\n"
    )
    words = ["--standard", INTERIM, "--arm", ARM_FILE, "--limits", limits]
    run(folder, *words, "--out", out, status=1)
    values = json.loads((out / "certificate.json").read_text())
    assert [value["tool"] for value in values["figures"]] == ["own probe", "star"]
    assert {value["tool"] for value in values["lengths"]} == {"own probe", "star"}
    vectors = {t["name"]: t["vector_mm"] for t in values["administration"]["tools"]}
    assert vectors == {
        "own probe": list(ARM.probe.vector_mm),
        "star": list(STAR_MM),
    }
    page = (out / "certificate.html").read_text()
    assert "interim check of length with star" in page
    assert re.search(r"Vector of star.*22\.0000, -6\.0000, 15\.0000 mm", page, re.S)
    run("--check", out)
    # A vector that was changed afterwards.
    data = out / "data" / "campaign.toml"
    data.write_text(data.read_text().replace("22.0", "22.1"))
    checked = run("--check", out, status=1)
    assert "data/campaign.toml was changed" in checked.output


def add_noise(folder):
    """Let no touch be to the last digit where another is, as copies are."""
    path, draw = folder / "poses.csv", np.random.default_rng(0)
    header, *rows = path.read_text().splitlines()
    at = header.split(",").index("J1_rad")
    lines = [header]
    for row in rows:
        cells = row.split(",")
        cells[at] = repr(float(cells[at]) + 1e-9 * draw.standard_normal())
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")


def test_both_tools_are_decided_on_and_the_worse_one_counts(tmp_path):
    wrong_mm = (STAR_MM[0] + 0.2, *STAR_MM[1:])
    folder = campaign(INTERIM, tmp_path, wrong_mm)
    state_all(folder)
    add_noise(folder)
    file = folder / "campaign.toml"
    bar = 'kind = "ball_bar"\n'
    file.write_text(file.read_text().replace(bar, f"{bar}distance_std_mm = 1e-4\n"))
    arm_file = write_numbered(ARM_FILE, tmp_path / "arm.toml")
    limits = tmp_path / "limits.toml"
    limits.write_text(limits_text(interim_length_mm=0.02))
    words = ["--standard", INTERIM, "--arm", arm_file, "--limits", limits]
    ran = run(folder, *words, status=1)
    conclusion = ran.output.splitlines()[-1]
    assert "Rejected: interim check of length with star." in conclusion
    assert "Accepted: interim check of length with own probe." in conclusion


def test_one_tool_of_all_poses_is_named_too(tmp_path):
    folder = campaign(INTERIM, tmp_path)
    header, *rows = (folder / "poses.csv").read_text().splitlines()
    rows = [row for row in rows if row.endswith(",star")]
    (folder / "poses.csv").write_text("\n".join([header, *rows]) + "\n")
    (only,) = read_by_tool(folder, ARM)
    assert only.tool.name == "star"
    assert only.errors_unknown.startswith("poses name tools")


def test_qif_keeps_the_tools_apart(tmp_path):
    wrong_mm = (STAR_MM[0] + OFF_MM, *STAR_MM[1:])
    folder, out = campaign("asme-b89.4.22", tmp_path, wrong_mm), tmp_path / "out"
    ran = run(
        *(folder, "--standard", "asme-b89.4.22", "--arm", ARM_FILE, "--out", out),
        status=1,
    )
    words = ["to-qif", ARM_FILE, "--out", tmp_path / "arm.qif", "--verification", out]
    ran = invoke("arm", *words, "--json")
    assert [row["of"] for row in json.loads(ran.stdout)["tests"]] == [
        "ASME B89.4.22 with own probe",
        "ASME B89.4.22 with star",
    ]
    text = (tmp_path / "arm.qif").read_text()
    values = json.loads((out / "certificate.json").read_text())
    for value in values["lengths"]:
        assert decimal_text(value["error_mm"]) in text


def test_a_digital_certificate_states_tools_and_vectors(tmp_path):
    folder, out = campaign(INTERIM, tmp_path), tmp_path / "out"
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(f"start_utc = 2026-11-20T09:00:00Z\n{text}")
    run(folder, "--standard", INTERIM, "--arm", ARM_FILE, "--out", out, status=1)
    laboratory = tmp_path / "laboratory.toml"
    laboratory.write_text(LABORATORY)
    certify(out, laboratory, None)
    text = (out / "dcc.xml").read_text()
    assert "interim check of length with star" in text
    assert "Vector of star" in text
    assert "[22.0, -6.0, 15.0] mm, as given" in text
    assert checked_certificate(out, []).problems == ()
