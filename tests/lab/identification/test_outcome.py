"""An identification is good only where everything that it rests on is established."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.simulated import DESIGN_ARM, bar, built, cones, simulate
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.identification.certificates import OF_RADII
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.files import identification_json
from traverse.lab.identification.results.outcome import CONDITIONS, outcome_of
from traverse.lab.outcomes.base import State
from traverse.lab.outcomes.identified import ContradictedCertificate

QUICK = Options(n_suggestions=0)
# Without the search for zeros and signs, which takes seconds and helps nothing.
NO_SEARCH = replace(QUICK, coarse_start=False)
BALL = {"id": "ball", "kind": "sphere", "radius_mm": 25.4}
TABLES = [*cones(2), bar(), BALL]


def shifted(campaign, shift_mm):
    """Certify radii that are smaller by a shift than what was touched."""
    changed = [
        artefact.model_copy(update={"radius_mm": artefact.radius_mm + shift_mm})
        if artefact.kind in ("sphere", "ball_bar")
        else artefact
        for artefact in campaign.artefacts
    ]
    return replace(campaign, artefacts=tuple(changed))


def test_every_condition_has_a_name_of_its_own():
    codes = [condition.code for condition in CONDITIONS]
    assert len(set(codes)) == len(codes)


def test_a_good_campaign_establishes_everything():
    result = identify(simulate(built(3), TABLES, 40, 7), DESIGN_ARM, QUICK)
    judged = outcome_of(result)
    # By chance a few of a hundred campaigns have too large residuals: not this one.
    assert judged.outcome.state is State.GOOD, judged.outcome.sentences
    assert set(judged.outcome.established) == {
        condition.code for condition in CONDITIONS
    }
    assert judged.writes_arm
    values = identification_json(result)
    assert (values["state"], values["reasons"]) == ("good", [])
    json.dumps(values, allow_nan=False)


def test_another_arms_file_is_bad_and_makes_no_arm_file():
    """The same number of joints, but hinges where the other has rolls."""
    axes = [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    joints = tuple(
        joint.model_copy(
            update={"axis": axes[index % 2], "link_mm": (40.0, 30.0, 150.0)}
        )
        for index, joint in enumerate(DESIGN_ARM.joints)
    )
    other = DESIGN_ARM.model_copy(update={"joints": joints})
    options = replace(NO_SEARCH, snooping=False)
    result = identify(simulate(built(3), TABLES, 12, 7), other, options)
    judged = outcome_of(result)
    assert judged.outcome.state is State.BAD
    assert not judged.writes_arm


def test_radii_that_are_all_off_alike_have_one_cause_and_blame_no_certificate():
    campaign = simulate(built(3), TABLES, 60, 7)
    result = identify(shifted(campaign, 0.05), DESIGN_ARM, QUICK)
    assert result.contradictions == ()
    assert result.contact_shift.artefacts == ("bar", "ball")
    # What was touched is smaller than certified.
    assert result.contact_shift.shift_mm == pytest.approx(-0.05, abs=0.005)
    judged = outcome_of(result)
    assert "radii" in judged.outcome.codes
    assert judged.outcome.state is State.DOUBT
    # The arm is as with right certificates.
    right = identify(campaign, DESIGN_ARM, QUICK)
    assert result.sigma0 == pytest.approx(right.sigma0, rel=0.05)


def test_a_single_wrong_radius_is_still_named():
    campaign = simulate(built(3), TABLES, 60, 7)
    ball = campaign.artefacts[-1].model_copy(update={"radius_mm": 26.4})
    wrong = replace(campaign, artefacts=(*campaign.artefacts[:-1], ball))
    result = identify(wrong, DESIGN_ARM, QUICK)
    assert [entry.artefact for entry in result.contradictions] == ["ball"]
    assert result.contact_shift is None
    assert outcome_of(result).outcome.state is State.BAD


def test_distances_wrong_by_one_factor_blame_no_right_ball():
    two_bars = [*cones(2), bar(), bar(id="bar-2"), BALL | {"radius_mm": 60.0}]
    campaign = simulate(built(3), two_bars, 60, 7)
    artefacts = [
        artefact.model_copy(update={"distance_mm": 401.0})
        if artefact.kind == "ball_bar"
        else artefact
        for artefact in campaign.artefacts
    ]
    wrong = replace(campaign, artefacts=tuple(artefacts))
    result = identify(wrong, DESIGN_ARM, NO_SEARCH)
    accused = [(entry.artefact, entry.length) for entry in result.contradictions]
    assert accused == [("bar", "distance_mm"), ("bar-2", "distance_mm")]
    assert all(OF_RADII in entry.or_else for entry in result.contradictions)
    assert outcome_of(result).outcome.state is State.BAD


def test_poses_that_are_there_twice_are_in_doubt():
    campaign = simulate(built(3), TABLES, 30, 7)
    twice = campaign.part(np.tile(np.arange(len(campaign.poses)), 2))
    result = identify(twice, DESIGN_ARM, NO_SEARCH)
    assert outcome_of(result).outcome.codes == ("repeated",)
    (reason,) = outcome_of(result).outcome.reasons
    assert reason.values == {"n_repeated": len(campaign.poses), "n": len(twice.poses)}


def test_poses_at_one_reach_are_in_doubt():
    campaign = simulate(built(3), TABLES, 60, 7)
    result = identify(campaign, DESIGN_ARM, NO_SEARCH)
    assert "reach" in outcome_of(result).outcome.established
    geometry = result.adjustment.state.arm.geometry
    centres_mm = probe_centre(geometry, campaign.poses.angles_rad)
    distances_mm = np.linalg.norm(centres_mm - centres_mm[0], axis=1)
    alike = campaign.part(np.flatnonzero(distances_mm < 30.0))
    outcome = outcome_of(replace(result, campaign=alike)).outcome
    assert "reach" in outcome.codes
    assert outcome.state is not State.GOOD


@pytest.mark.parametrize("joint", [1, 3])
def test_a_wrong_sign_is_named_with_its_joint(joint):
    true = built(3)
    campaign = simulate(true, TABLES, 30, 7)
    angles_rad = campaign.poses.angles_rad.copy()
    angles_rad[:, joint] *= -1.0
    campaign = campaign.with_poses(angles_rad=angles_rad)
    result = identify(campaign, DESIGN_ARM, QUICK)
    name = DESIGN_ARM.joints[joint].name
    assert result.wrong_signs == (name,)
    assert result.contradictions == ()
    judged = outcome_of(result)
    assert judged.outcome.codes == ("arm_file",)
    assert f"{name} turns the other way" in judged.outcome.sentences[0]
    # The axis of the identified arm points the other way, and the lengths are right.
    axis = np.array(result.arm.joints[joint].axis)
    assert axis @ np.array(DESIGN_ARM.joints[joint].axis) < -0.99
    assert result.sigma0 < 1.2


def test_an_arm_that_shrank_is_refused():
    result = identify(simulate(built(3), TABLES, 25, 7), DESIGN_ARM, QUICK)
    geometry = result.adjustment.state.arm.geometry
    tiny = replace(geometry, links_mm=1e-3 * geometry.links_mm)
    adjustment = replace(
        result.adjustment,
        state=replace(
            result.adjustment.state,
            arm=replace(result.adjustment.state.arm, geometry=tiny),
        ),
    )
    # It contradicts every certificate; and one that agrees with the arm is right.
    accused = ContradictedCertificate(
        artefact="bar",
        length="distance_mm",
        certified_mm=400.0,
        value_mm=5.0,
        std_mm=0.1,
        sigmas=40.0,
        or_else=(),
    )
    result = replace(result, contradictions=(accused,))
    judged = outcome_of(replace(result, adjustment=adjustment))
    assert "size" in judged.outcome.codes
    assert "certificates" not in judged.outcome.codes
    assert not judged.writes_arm
    assert "certificates" in outcome_of(result).outcome.codes
    agreeing = replace(accused, value_mm=400.1)
    result = replace(result, contradictions=(agreeing,))
    assert "certificates" not in outcome_of(result).outcome.codes


def off_in_std(result, true, readings_rad, angles_rad):
    """Compare lengths from each posture to the next with the truth, and their std."""
    arm = result.adjustment.state.arm
    derivatives = probe_derivatives(arm.geometry, readings_rad)
    apart_mm = np.diff(derivatives.centres_mm, axis=0)
    lengths_mm = np.linalg.norm(apart_mm, axis=1)
    columns = result.adjustment.network.parameters.columns(
        arm, derivatives, result.campaign.poses.part(slice(0))
    )
    ways = apart_mm / lengths_mm[:, np.newaxis]
    gradients = np.einsum("ni,nip->np", ways, np.diff(columns, axis=0))
    stds_mm = np.sqrt(np.sum((gradients @ result.covariance) * gradients, axis=1))
    true_mm = np.linalg.norm(np.diff(true.centres(angles_rad), axis=0), axis=1)
    return (lengths_mm - true_mm) / stds_mm, stds_mm / lengths_mm


def test_lengths_say_how_little_an_undetermined_scale_tells():
    """Without a length the scale is the design's, and so is its error."""
    offs = []
    for seed in range(5):
        nominal = built(seed)
        scale = 1.0 + 0.003 * (seed - 2.2)
        true = replace(nominal, links_mm=scale * nominal.links_mm)
        result = identify(simulate(true, cones(3), 40, seed), DESIGN_ARM, QUICK)
        pair_rad = result.campaign.poses.angles_rad[[0, 50]]
        (off,), (relative_std,) = off_in_std(result, true, pair_rad, pair_rad)
        offs.append(off)
        # It was stated to some micrometres.
        assert relative_std > 1e-4
    assert np.max(np.abs(offs)) < 2.0


def test_new_postures_lie_within_what_is_stated_though_an_effect_is_missing():
    """A ring whose readings swing three times a turn."""
    true = built(3)

    def read(angles_rad):
        wrong_rad = np.zeros_like(angles_rad)
        wrong_rad[:, 1] = 1e-4 * np.cos(3.0 * angles_rad[:, 1])
        return angles_rad + wrong_rad

    campaign = simulate(true, TABLES, 40, 7)
    measured = campaign.with_poses(angles_rad=read(campaign.poses.angles_rad))
    result = identify(measured, DESIGN_ARM, NO_SEARCH)
    new_rad = np.random.default_rng(5).uniform(-2.5, 2.5, (200, 7)) + true.zeros_rad
    off = np.abs(off_in_std(result, true, read(new_rad), new_rad)[0])
    assert np.mean(off < 2.0) > 0.95
    # By what residuals alone say, of which the parameters took a part up.
    scaled_only = off * np.sqrt(result.variance_factor) / result.sigma0
    assert np.mean(scaled_only < 2.0) < 0.9


def test_an_arm_that_is_far_from_its_design_is_in_doubt():
    """All fits, but a link of the file is 60 mm off: perhaps another arm's."""
    true = built(3)
    links_mm = true.links_mm.copy()
    links_mm[3] += [0.0, 0.0, 60.0]
    campaign = simulate(replace(true, links_mm=links_mm), TABLES, 30, 7)
    judged = outcome_of(identify(campaign, DESIGN_ARM, NO_SEARCH))
    assert "design" in judged.outcome.codes
    (reason,) = [reason for reason in judged.outcome.reasons if reason.code == "design"]
    assert reason.values["parameter"].startswith("J4.link")
    assert reason.values["deviations"] == pytest.approx(12.0, abs=1.0)
