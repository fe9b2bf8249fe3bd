"""Compliances of arms without masses: moments are estimated with them, or held."""

import json

import numpy as np
import pytest

from benchmarks.blind.hidden.poses import weighed, without_masses
from benchmarks.proofs.conditions import demo_arm
from tests.lab.diagnosis.engine_campaigns import hidden, measured_with
from traverse.kinematics.arm_file.arm import effect_from_table, read_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.lab.first_moments import assumed_moments, with_first_moments
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import result_map, summary_lines
from traverse.lab.identification.results.files import (
    identification_json,
    write_result,
)

FREE = Options(free=("*_compliance.*",), n_suggestions=2)
ZERO = tuple(
    effect_from_table({"kind": kind, "joint": joint, "compliance_rad_nm": 0.0})
    for kind, joint in [("joint_compliance", "J2"), ("bearing_compliance", "J3")]
)
HEAVY = weighed(demo_arm()).model_copy(update={"effects": ZERO})
BARE = without_masses(HEAVY)


@pytest.fixture(scope="module")
def campaign():
    return measured_with(
        hidden("joint_compliance", 25.0, "J2"), hidden("bearing_compliance", 25.0, "J3")
    )


@pytest.fixture(scope="module")
def result(campaign):
    return identify(campaign, BARE, FREE)


def test_one_distribution_serves_both_as_well_as_the_true_masses(campaign, result):
    known = identify(campaign, HEAVY, FREE)
    assert result.converged
    assert result.rms_after_mm < 1.02 * known.rms_after_mm
    assert result.sigma0 < 1.02 * known.sigma0
    compliances = [e for e in result.arm.effects if e.kind != "first_moment"]
    assert all(each.compliance_rad_nm > 0.0 for each in compliances)
    # What compliances do to the ball is that of compliances times moments.
    true = [effect.compliance_rad_nm for effect in known.arm.effects]
    levers = [
        effects_from_arm(of.arm).levers_kg_mm(of.adjustment.state.arm.geometry)
        for of in (result, known)
    ]
    products = [
        compliances[at].compliance_rad_nm * levers[0][4] / (true[at] * levers[1][4])
        for at in (0, 1)
    ]
    assert [p[0] for p in products] == pytest.approx([1.0, 1.0], abs=0.2)


def test_what_was_estimated_of_masses_is_reported(tmp_path, result):
    lines = " ".join(summary_lines(result, result_map(result)))
    assert "The arm file states no masses" in lines
    distribution = identification_json(result)["mass_distribution"]
    assert distribution["combinations"] == 18
    assert 5 <= len(distribution["determined"]) < 18
    free = [p.name for p in result.parameters]
    assert "J2.first_moment.moment_kg_m.x" in free
    arm = write_result(result, tmp_path)
    assert read_arm(tmp_path / "arm.toml") == arm
    assert [e.joint for e in arm.effects[2:]] == ["J2", "J3", "J4", "J5", "J6", "J7"]
    assert (
        arm.identification.design_digest
        == json.loads((tmp_path / "identification.json").read_text())["inputs"][
            "arm_digest"
        ]
    )


def test_held_moments_are_those_of_an_arm_of_usual_build(campaign):
    options = Options(free=FREE.free, hold=("*.first_moment.*",), n_suggestions=0)
    result = identify(campaign, BARE, options)
    assumed = assumed_moments(BARE)
    moments = [e for e in result.arm.effects if e.kind == "first_moment"]
    np.testing.assert_allclose(
        [moment.moment_kg_m for moment in moments], assumed.moments_kg_m[1:], atol=1e-12
    )
    assert "mass_distribution" not in identification_json(result)


def test_moments_are_held_with_the_compliances(campaign, result):
    again = identify(campaign, result.arm, Options(n_suggestions=0))
    assert again.arm.effects == result.arm.effects
    assert not any("moment" in parameter.name for parameter in again.parameters)


def test_without_gravity_no_moment_is_added():
    plain = BARE.model_copy(update={"effects": ()})
    assert with_first_moments(plain).effects == ()
    # Those of effects that are gone, too.
    left = with_first_moments(BARE).effects[2:]
    assert len(left) == 6
    assert with_first_moments(BARE.model_copy(update={"effects": left})).effects == ()
    assert with_first_moments(HEAVY).effects == ZERO
