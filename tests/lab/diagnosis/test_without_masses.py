"""Arms whose file states no masses: what gravity does is found all the same."""

import json
from functools import cache

import numpy as np
import pytest

from benchmarks.blind.hidden.poses import weighed, without_masses
from benchmarks.proofs.conditions import demo_arm
from tests.lab.diagnosis.engine_campaigns import (
    DECISION,
    OPTIONS,
    decided,
    hidden,
    measured_with,
    poses,
)
from traverse.kinematics.arm_file.arm import parse_arm, read_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.diagnosis.advice.minimal_detectable import planned
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.report.files import summary_lines, write_diagnosis
from traverse.lab.first_moments import assumed_moments, with_first_moments
from traverse.lab.identification.prediction import placed, places_of, predict
from traverse.strict_toml.rewriting import rewritten_text

BARE = without_masses(weighed(demo_arm()))
# How much worse than with the true masses held-out poses are predicted, at most.
NEAR = 1.05


def kinds(arm):
    return [effect.kind for effect in arm.effects]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "joint"),
    [
        ("joint_compliance", "J2"),
        ("bearing_compliance", None),
        ("mount_compliance", None),
    ],
)
def test_what_yields_is_named_and_predicts_nearly_as_with_the_true_masses(kind, joint):
    wrong, known = hidden(kind, 25.0, joint), decided(kind, 25.0, joint)
    diagnosis = diagnose(known.campaign, BARE, DECISION)
    (term,) = diagnosis.terms
    assert (diagnosis.verdict, term.candidate.kind, term.candidate.joint) == (
        "named",
        kind,
        wrong.joint,
    )
    assert diagnosis.gap.after.rms_mm < NEAR * known.gap.after.rms_mm
    assert diagnosis.gap.after.rms_mm < 0.7 * diagnosis.gap.before.rms_mm
    compliance = term.parameters["compliance_rad_nm"]
    assert compliance.value > 10.0 * compliance.std
    assert known.all_terms.mass_distribution() == {}
    masses = diagnosis.all_terms.mass_distribution()
    assert 0 < len(masses["determined"]) < masses["combinations"]


@cache
def yielding():
    """A campaign in which J3 yields, and its diagnosis."""
    campaign = measured_with(hidden("joint_compliance", 25.0, "J3"))
    return campaign, diagnose(campaign, BARE, OPTIONS)


@pytest.mark.slow
def test_the_arm_that_is_written_is_applied_as_it_is(tmp_path):
    campaign, diagnosis = yielding()
    source = tmp_path / "source.toml"
    source.write_text(
        rewritten_text(BARE.model_dump(by_alias=True, exclude_unset=True))
    )
    assert read_arm(source) == BARE
    write_diagnosis(tmp_path / "out", diagnosis, source)
    arm = read_arm(tmp_path / "out" / "arm.toml")
    assert kinds(arm) == ["joint_compliance", *["first_moment"] * 5]
    assert [e.joint for e in arm.effects] == ["J3", "J3", "J4", "J5", "J6", "J7"]
    values = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    masses = values["mass_distribution"]
    mass_kg = assumed_moments(BARE).mass_kg
    assert masses["assumed_mass_kg"] == pytest.approx(mass_kg, rel=1e-3)
    assert list(masses["first_moments_kg_m"]) == ["J3", "J4", "J5", "J6", "J7"]
    assert masses["combinations"] == 15
    for sum_of_masses in masses["determined"]:
        assert sum_of_masses["std"] < 0.5
        names = sum_of_masses["direction"]
        assert all(".first_moment.moment_kg_m." in name for name in names)
    lines = " ".join(summary_lines(diagnosis))
    assert "states no masses" in lines
    assert f"determine {len(masses['determined'])} of its 15 combinations" in lines
    assert "states no masses" in (tmp_path / "out" / "report.html").read_text()
    distances_mm = [
        predict(campaign, of, places_of(placed(campaign, of))).distances_mm
        for of in (arm, arm.model_copy(update={"effects": ()}))
    ]
    assert np.mean(distances_mm[0]) < 0.7 * np.mean(distances_mm[1])
    block = campaign.block()
    effects = effects_from_arm(parse_arm((tmp_path / "out" / "arm.toml").read_text()))
    moved = corrected_pose(geometry_from_arm(arm), effects, block)[0]
    rigid = corrected_pose(geometry_from_arm(arm), effects_from_arm(BARE), block)[0]
    assert np.abs(moved - rigid).max() > 0.005


def test_nothing_is_found_and_nothing_written_where_nothing_yields():
    diagnosis = diagnose(measured_with(), BARE, DECISION)
    assert diagnosis.verdict == "clean"
    assert diagnosis.adapted.effects == ()
    assert diagnosis.all_terms.mass_distribution() == {}


@pytest.mark.slow
def test_an_eccentricity_is_none_of_it():
    diagnosis = diagnose(
        measured_with(hidden("encoder_eccentricity", 25.0, "J2")), BARE, DECISION
    )
    assert [t.candidate.kind for t in diagnosis.terms] == ["encoder_eccentricity"]
    assert kinds(diagnosis.adapted) == ["encoder_eccentricity"]


@pytest.mark.slow
def test_an_arm_that_was_diagnosed_is_diagnosed_again():
    campaign, first = yielding()
    again = diagnose(campaign, first.adapted, DECISION)
    assert again.verdict == "clean"
    assert kinds(again.adapted) == kinds(first.adapted)
    assert again.gap.after.rms_mm == pytest.approx(first.gap.after.rms_mm, rel=1e-3)


def test_sizes_that_could_be_found_are_those_of_the_assumed_masses():
    campaign = measured_with()
    with_masses, without = (
        {(e.candidate.kind, e.candidate.joint): e for e in planned(campaign, arm)}
        for arm in (poses().arm, BARE)
    )
    name = "joint_compliance", "J2"
    assert set(with_masses) == set(without)
    assert without[name].key == "compliance_rad_nm"
    assert without[name].minimum == without[name].best
    assert 0.1 < without[name].minimum.value / with_masses[name].minimum.value < 1.0


def test_masses_that_are_known_are_left_alone():
    arm = poses().arm
    assert with_first_moments(arm) is arm
