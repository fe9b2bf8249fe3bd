"""Effects that turn the last body are found by measured orientations."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tools.handover import campaign_from_simulation
from tests.simulator.effects.examples import heavy_arm, spec_of
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.adjustment import Problem
from traverse.lab.diagnosis.advice.minimal_detectable import planned_equations
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.fit import with_effects as with_other_effects
from traverse.lab.diagnosis.report.files import summary_lines
from traverse.lab.diagnosis.report.outcome import diagnosis_json
from traverse.lab.identification.identify import Options
from traverse.simulator.campaigns import (
    NoiseTable,
    Points,
    draw_noise,
    make_poses,
    with_effects,
)

ARM = heavy_arm()
NOISE = NoiseTable(encoder_rad=5e-6, contact_mm=0.02, orientation_rad=5e-5)
TRACKER = Points(
    id="tracker", n_poses=160, n_points=160, size_mm=450.0, orientations=True
)
WOBBLE = {
    "kind": "axis_wobble",
    "joint": "J7",
    "order": 2,
    "cos_rad": [0.0, 1e-4, -5e-5],
    "sin_rad": [0.0, 2e-5, 1e-4],
}


@pytest.fixture(scope="module")
def poses():
    return make_poses(ARM, spec_of(TRACKER), 3)


def measured(poses, noise=NOISE):
    return campaign_from_simulation(draw_noise(poses, 1, noise).campaign)


def turned_lines(poses, noise):
    truth = draw_noise(poses, 1, noise).truth
    return {blunder.line for blunder in truth.blunders if blunder.kind == "orientation"}


def without(campaign):
    return campaign.with_poses(orientations=None)


@pytest.mark.slow
def test_an_axis_that_wobbles_is_named_which_positions_do_not_show(poses):
    played = with_effects(poses, (effect_from_table(WOBBLE),))
    campaign = measured(played)
    diagnosis = diagnose(campaign, ARM)
    assert diagnosis.verdict == "named"
    (term,) = diagnosis.terms
    assert term.candidate.name == "axis_wobble 2 J7"
    for key in ("cos_rad", "sin_rad"):
        estimate, true = term.parameters[key], played.effects[0].values[key]
        away = np.subtract(estimate.value, true)
        assert np.all(np.abs(away) < 5.0 * np.array(estimate.std) + 2e-6)
    assert diagnose(without(campaign), ARM).verdict == "clean"


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_and_blunders_are_no_effects(poses):
    spoilt = NOISE.model_copy(
        update={"blunder_share": 0.03, "blunder_kinds": ("orientation",)}
    )
    for noise in (NOISE, spoilt):
        diagnosis = diagnose(measured(poses, noise), ARM)
        assert (diagnosis.verdict, diagnosis.terms) == ("clean", ())
        # The positions of poses with a wrong orientation take part.
        assert not np.any(diagnosis.excluded)
        lines = diagnosis.campaign.poses.lines
        wrong = turned_lines(poses, noise) & set(lines[diagnosis.choosing].tolist())
        assert set(lines[diagnosis.turned].tolist()) == wrong
        listed = diagnosis_json(diagnosis)["orientations"]["excluded"]
        assert {row["line"] for row in listed} == wrong
        text = "\n".join(summary_lines(diagnosis))
        assert ("Orientations that contradict the rest" in text) == bool(wrong)
    assert wrong


def test_columns_of_effects_are_what_they_do_to_the_rows(poses):
    """Of positions and orientations, by an arm that has a little of the effect."""
    campaign = measured(poses)
    rows = planned_equations(campaign, ARM)
    bank = library_bank(rows, ARM)
    network, state = rows.adjustment.network, rows.adjustment.state
    (station,), (unknowns,) = network.stations, state.unknowns
    white = rows.adjustment.system.whiteners[0]
    looked_at = set()
    for candidate, columns in zip(bank.candidates, bank.slices, strict=True):
        kind, joint = candidate.kind, candidate.joint
        if (kind, joint) not in {
            ("encoder_eccentricity", "J6"),
            ("joint_compliance", "J2"),
            ("bearing_compliance", "J3"),
        }:
            continue
        looked_at.add(kind)
        sizes = dict.fromkeys(candidate.parameters, 0.0)
        for index, name in enumerate(candidate.parameters):
            step = 0.1 * candidate.scales[index]
            ends = []
            for sign in (1.0, -1.0):
                table = {"kind": kind, "joint": joint, **sizes, name: sign * step}
                arm = with_other_effects(ARM, (effect_from_table(table),))
                problem = Problem.of(campaign, arm, Options())
                amplitudes = problem.design.amplitudes
                moved = replace(state.arm, amplitudes=amplitudes)
                other = replace(network, parameters=problem.parameters)
                misclosures = other.all_misclosures(station, moved, unknowns)
                ends.append((white @ misclosures[:, :, None]).ravel())
            # A model that has the effect misses by less where the arm has it.
            slope = (ends[0] - ends[1]) / 0.2
            column = bank.columns[:, columns][: len(slope), index]
            assert column == pytest.approx(slope, abs=5e-3 * np.abs(slope).max())
    assert looked_at == {
        "encoder_eccentricity",
        "joint_compliance",
        "bearing_compliance",
    }
