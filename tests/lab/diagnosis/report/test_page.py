"""The page of a diagnosis: complete, in one piece, true to the result."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.lab.diagnosis.diagnosed import (
    COS_RAD,
    SIN_RAD,
    clean,
    eccentric,
    written_files,
)
from tests.lab.diagnosis.report.test_words import DETECTABLE, candidate
from tests.lab.report.pages import Page
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.report.discrepancies import discrepancies
from traverse.lab.diagnosis.report.files import report_page
from traverse.lab.diagnosis.report.pictures import Plots, paint_ledger, plots_of
from traverse.lab.diagnosis.report.term_curve import term_curve
from traverse.lab.outcomes.diagnosis import Estimate
from traverse.lab.report.figures import binned

SECTIONS = [
    "verdict",
    "ledger",
    "terms",
    "maps",
    "leftovers",
    "detectable",
    "excluded",
    "method",
]


@pytest.fixture(scope="module")
def plots():
    diagnosis = eccentric()
    noise = diagnosis.all_terms.network.noise
    pictures = {k: png for k, png in written_files().items() if k.endswith(".png")}
    return Plots(
        discrepancies(diagnosis.before, noise),
        discrepancies(diagnosis.after, noise),
        pictures,
    )


@pytest.fixture(scope="module")
def text(plots) -> str:
    return report_page(replace(eccentric(), detectable=DETECTABLE), plots)


@pytest.fixture(scope="module")
def page(text) -> Page:
    return Page(text)


def test_every_section_is_there_and_can_be_jumped_to(page):
    assert page.sections == SECTIONS
    assert {link.removeprefix("#") for link in page.links} == set(SECTIONS[1:])


def test_nothing_outside_is_referred_to(page):
    page.check_is_self_contained()


def test_the_page_holds_the_pictures_that_are_files_too(plots, page):
    assert set(page.pictures) == set(plots.files.values())
    assert set(plots.files) == {
        "ledger.png",
        "term-1.png",
        "artefacts.png",
        "joints.png",
        "conditions.png",
    }
    assert sum(len(png) for png in plots.files.values()) < 600_000


def test_the_verdict_is_first(page):
    assert page.text.index("Missing effect: encoder eccentricity, joint J3") < (
        page.text.index("Held-out misfit")
    )


def test_figures_are_those_of_the_result(page):
    diagnosis = eccentric()
    for step in diagnosis.ledger:
        assert f"{step.held_out.rms_mm:.5f}" in page.cells
        assert f"{step.held_out.chi2:.3f}" in page.cells
    (term,) = diagnosis.terms
    at = page.cells.index("cos_rad")
    shown = [float(cell) for cell in page.cells[at + 1 : at + 3]]
    expected = [term.parameters["cos_rad"].value, term.parameters["cos_rad"].std]
    assert shown == pytest.approx(expected, rel=0.05)
    assert page.cells[at + 3] == "rad"
    line = str(int(diagnosis.campaign.poses.lines[100]))
    assert line in page.cells
    assert f"Seed {diagnosis.seed}" in page.text
    assert "encoder eccentricity [µrad]" in page.cells
    at = page.cells.index("drift of the base")
    assert page.cells[at + 1 : at + 3] == ["10 nm/s", "3 µm"]
    (shown,) = (words for words in page.words if words.startswith("Not detectable"))
    assert shown == (
        "Not detectable. J1 is vertical: gravity does not twist it: torsion under "
        "gravity, joint J1."
    )


def test_large_misfits_are_written_as_plain_numbers():
    diagnosis = eccentric()
    ledger = tuple(
        replace(step, held_out=replace(step.held_out, chi2=chi2))
        for step, chi2 in zip(diagnosis.ledger, (250.0, 1.0), strict=True)
    )
    figure = Figure()
    paint_ledger(figure, replace(diagnosis, ledger=ledger))
    figure.canvas.draw()
    right = figure.axes[1]
    labels = [label.get_text() for label in right.get_xticklabels()]
    assert {"1", "10", "100"} <= set(labels)
    assert not any(label.get_text() for label in right.get_xticklabels(minor=True))


def test_clean_has_a_page_too():
    page = Page(report_page(clean(), plots_of(clean())))
    assert page.sections == SECTIONS
    assert "Clean: no effect" in page.text
    assert "Nothing was found." in page.text
    assert len(page.images) == 4


def test_the_curve_of_a_term_is_the_term_and_the_data_lie_on_it(plots):
    diagnosis = eccentric()
    curve = term_curve(diagnosis, diagnosis.terms[0], plots.before, plots.after)
    angles_rad = diagnosis.campaign.poses.angles_rad[:, 2]
    assert np.array_equal(curve.covariate.values, np.degrees(angles_rad))
    effect = diagnosis.terms[0].effect
    expected_rad = effect.cos_rad * np.cos(angles_rad) + effect.sin_rad * np.sin(
        angles_rad
    )
    assert np.allclose(curve.fitted, expected_rad, atol=1e-9)
    # The band, from the covariance of cosine and sine, holds the truth.
    true_rad = COS_RAD * np.cos(angles_rad) + SIN_RAD * np.sin(angles_rad)
    assert np.all(np.abs(curve.fitted - true_rad) < 4.0 * curve.band)
    good = ~diagnosis.excluded
    slope = np.polyfit(curve.fitted[good], (curve.after + curve.fitted)[good], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.15)
    before = np.sqrt(np.mean((curve.before[good] / curve.stds[good]) ** 2))
    after = np.sqrt(np.mean((curve.after[good] / curve.stds[good]) ** 2))
    assert after < 1.3 < before


EFFECTS = [
    {"kind": "encoder_harmonic", "joint": "J1", "order": 17},
    {"kind": "encoder_latency", "latency_s": 1e-5},
    {"kind": "encoder_latency", "joint": "J2", "latency_s": 1e-5},
    {"kind": "encoder_temperature", "joint": "J2", "rate_rad_c": 1e-6},
    {"kind": "backlash", "joint": "J2", "half_width_rad": 1e-5},
    {"kind": "joint_compliance", "joint": "J2", "compliance_rad_nm": 1e-6},
    {"kind": "mount_compliance", "compliance_rad_nm": 1e-6},
    {"kind": "thermal_expansion", "expansion_per_c": 1e-5},
    {"kind": "thermal_expansion", "joint": "J3", "expansion_per_c": 1e-5},
    {"kind": "probe_radius", "radius_error_mm": 0.003},
    {"kind": "probe_lobing", "amplitude_mm": 0.003, "phase_rad": 1.0},
    {"kind": "base_drift", "rate_mm_s": [1e-5, 0.0, 0.0]},
    {"kind": "base_step", "at_s": 300.0, "step_mm": [0.0, 0.01, 0.0]},
    {"kind": "count_slip", "joint": "J3", "at_s": 300.0, "step_rad": 1e-5},
    {
        "kind": "empirical",
        "joint": "J3",
        "covariate": "J5_rad",
        "knots": [-1.0, 0.0, 1.0],
        "values_rad": [0.0, 1e-5, 0.0],
    },
]


@pytest.mark.parametrize(
    "table", EFFECTS, ids=lambda t: f"{t['kind']} {t.get('joint')}"
)
def test_every_kind_is_reported_over_what_matters_for_it(table, plots):
    diagnosis = eccentric()
    started = diagnosis.campaign.start_utc
    keys = dict(table)
    if keys["kind"] in ("base_drift", "base_step", "count_slip"):
        keys["epoch_utc"] = started
    if keys["kind"] == "encoder_harmonic":
        keys |= {"cos_rad": 1e-5, "sin_rad": 0.0}
    effect = effect_from_table(keys)
    numbers = {
        key: value
        for key, value in effect.values.items()
        if isinstance(value, float | tuple) and key != "knots"
    }
    term = replace(
        diagnosis.terms[0],
        effect=effect,
        candidate=candidate(
            effect.kind,
            effect.joint,
            order=keys.get("order"),
            covariate=keys.get("covariate"),
        ),
        parameters={
            key: Estimate(
                value,
                tuple(0.1 * abs(v) for v in value)
                if isinstance(value, tuple)
                else 0.1 * abs(value),
                "rad",
            )
            for key, value in numbers.items()
        },
    )
    curve = term_curve(diagnosis, term, plots.before, plots.after)
    seen = np.isfinite(curve.stds) & np.isfinite(curve.covariate.values)
    assert np.count_nonzero(seen) > 0.5 * len(seen)
    assert np.abs(curve.fitted[seen]).max() > 0.0
    assert np.all(np.isfinite(curve.band[seen]))
    if curve.covariate.is_function:
        # The same covariate, the same amount: a line can be drawn.
        order = np.argsort(curve.covariate.values[seen])
        steps = np.abs(np.diff(curve.fitted[seen][order]))
        apart = np.diff(curve.covariate.values[seen][order])
        assert np.all(steps[apart == 0.0] < 1e-3 * np.abs(curve.fitted[seen]).max())


def test_the_length_of_a_standard_moves_no_pose(plots):
    diagnosis = eccentric()
    effect = effect_from_table(
        {"kind": "artefact_length", "artefact": "bar", "error_ppm": 12.0}
    )
    term = replace(
        diagnosis.terms[0],
        effect=effect,
        candidate=candidate("artefact_length", artefact="bar"),
        parameters={"error_ppm": Estimate(12.0, 1.0, "ppm")},
    )
    assert term_curve(diagnosis, term, plots.before, plots.after) is None


def test_means_over_parts_of_a_range():
    x = np.repeat([-1.0, 1.0], 50)
    y = np.where(x < 0, 3.0, 5.0) + np.tile([-1.0, 1.0], 50)
    in_parts = binned(x, y)
    assert in_parts.centres.tolist() == [-1.0, 1.0]
    assert in_parts.means.tolist() == [3.0, 5.0]
    assert np.allclose(in_parts.errors, 1.0 / 7.0)
    many = binned(np.arange(1000.0), np.arange(1000.0))
    assert len(many.centres) == 24
    assert np.allclose(many.means, many.centres)


def test_noisy_poses_weigh_less_in_means():
    x, y = np.zeros(4), np.array([1.0, 1.0, 9.0, 9.0])
    in_parts = binned(x, y, np.array([1.0, 1.0, 1e3, 1e3]))
    assert in_parts.means[0] == pytest.approx(1.0, abs=1e-4)


def test_no_poses_have_no_means():
    nothing = np.full(3, np.nan)
    assert len(binned(nothing, nothing).centres) == 0
