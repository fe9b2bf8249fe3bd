"""Whole diagnoses of simulated campaigns: what is reported, and what is not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.lab.diagnosis import diagnosed
from tests.lab.diagnosis.diagnosed import (
    ECCENTRIC,
    clean,
    eccentric,
    eccentric_campaign,
)
from tests.lab.diagnosis.engine_campaigns import (
    DECISION,
    OPTIONS,
    hidden,
    measured_with,
    poses,
)
from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.simulated import arm_value, disturbed, seen_places, seven_joints
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.campaign import campaign_of_places
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.holdout.comparison import compare_on_holdout
from traverse.lab.diagnosis.model.fit import with_effects
from traverse.lab.diagnosis.report.files import WORDS, summary_lines
from traverse.lab.diagnosis.report.outcome import diagnosis_json


def decided(campaign, options=DECISION):
    return diagnose(campaign, poses().arm, options)


def names(diagnosis):
    return [(term.candidate.kind, term.candidate.joint) for term in diagnosis.terms]


def bump():
    """Lines of an encoder are damaged over a fifth of the joint's travel."""
    return hidden("bump", 30.0, draw=8)


@cache
def bumpy():
    return decided(measured_with(bump()), OPTIONS)


def test_nothing_is_found_where_nothing_is_missing():
    diagnosis = decided(measured_with(seed=1))
    assert diagnosis.verdict == "clean"
    assert diagnosis.terms == ()
    assert diagnosis.gap.closed is None
    assert not np.any(diagnosis.blunders)
    assert not diagnosis.vetoed
    assert [step.effect for step in diagnosis.ledger] == [None]
    assert diagnosis.ledger[0].held_out.chi2 == pytest.approx(1.0, abs=0.35)
    assert all(
        remainder.log10_p > remainder.threshold_log10_p
        for remainder in diagnosis.leftovers
    )
    assert diagnosis.adapted.effects == ()


def test_a_wrong_noise_level_is_no_effect():
    # Three fifths of the noise are stated.
    diagnosis = decided(measured_with(seed=4, stated_factor=0.6))
    assert (diagnosis.verdict, diagnosis.terms) == ("unexplained", ())


@pytest.mark.slow
def test_noise_that_nobody_states_is_estimated():
    diagnosis = decided(measured_with(hidden("backlash", 15.0), seed=5, stated=False))
    assert names(diagnosis)[0][0] == "backlash"
    assert np.mean(diagnosis.noise.encoder_rad) == pytest.approx(5e-6, rel=0.5)


def test_an_eccentricity_is_named_with_its_size():
    diagnosis = eccentric()
    assert diagnosis.verdict == "named"
    (term,) = diagnosis.terms
    assert names(diagnosis) == [("encoder_eccentricity", "J3")]
    for key in ("cos_rad", "sin_rad"):
        estimate = term.parameters[key]
        assert abs(estimate.value - ECCENTRIC[key]) < 3.0 * estimate.std
        assert 0.0 < estimate.std < 3e-6
        assert estimate.unit == "rad"
        assert term.effect.values[key] == estimate.value
    assert term.accepted
    assert diagnosis.adapted.effects == (term.effect,)
    assert term.log_bayes_factor > 20.0
    assert term.log10_p < -10.0


def test_the_gap_closes_on_poses_that_were_kept_aside():
    diagnosis = eccentric()
    assert diagnosis.gap.closed > 0.9
    assert not diagnosis.vetoed
    assert not np.any(diagnosis.choosing & diagnosis.held_out)
    assert diagnosis.held_out.mean() == pytest.approx(0.3, abs=0.05)
    used = np.concatenate([s.poses for s in diagnosis.after.network.stations])
    assert not np.any(diagnosis.held_out[used])
    assert not np.any(diagnosis.excluded & ~diagnosis.choosing)
    assert diagnosis.excluded.sum() <= 3


def test_the_ledger_tells_every_step():
    diagnosis = eccentric()
    start, last = diagnosis.ledger
    assert (start.effect, last.effect) == (None, "encoder_eccentricity J3")
    assert start.held_out.n == last.held_out.n > 50
    assert start.held_out.chi2 > 1.5
    assert last.held_out.chi2 < 1.2
    assert start.held_out.rms_mm > last.held_out.rms_mm > 0.0
    assert start.sigma0 > 1.2 > last.sigma0
    s = [step.held_out.chi2 for step in diagnosis.ledger]
    assert diagnosis.gap.closed == pytest.approx((s[0] - s[1]) / (s[0] - 1.0))
    again = compare_on_holdout(diagnosis.before, diagnosis.after, diagnosis.held_out)
    assert again.closed == pytest.approx(diagnosis.gap.closed)


def test_what_could_have_been_seen_is_reported_of_every_kind():
    kinds = {size.candidate.kind for size in eccentric().detectable}
    assert {"encoder_eccentricity", "base_drift", "thermal_expansion"} <= kinds
    for size in eccentric().detectable:
        assert size.minimum is None or 0.0 < size.best.value <= size.minimum.value
        assert (size.minimum is None) == bool(size.why)


@pytest.mark.slow
def test_a_bump_is_unknown_at_its_joint_and_becomes_a_curve():
    diagnosis, wrong = bumpy(), bump()
    assert diagnosis.verdict == "unknown"
    unknown = [term for term in diagnosis.terms if term.status == "unknown"]
    assert {term.candidate.joint for term in unknown} == {wrong.joint}
    term = unknown[0]
    assert term.candidate.kind == term.effect.kind == "empirical"
    assert term.candidate.covariate == f"{wrong.joint}_rad"
    assert term.accepted
    assert term.effect in diagnosis.adapted.effects
    assert diagnosis.gap.closed > 0.75


@pytest.mark.slow
def test_the_curve_of_a_bump_is_where_the_bump_is():
    wrong = bump()
    (term,) = [term for term in bumpy().terms if term.status == "unknown"]
    knots = np.array(term.effect.values["knots"])
    values = np.array(term.effect.values["values_rad"])
    top = np.argmax(np.sign(wrong.fault.height_rad) * (values - np.median(values)))
    spacing = np.diff(knots).max()
    assert abs(knots[top] - wrong.fault.middle_rad) < spacing


@pytest.mark.slow
def test_blunders_do_not_hide_an_effect():
    share = 0.05
    wrong = hidden("encoder_eccentricity", 20.0)
    diagnosis = decided(measured_with(wrong, blunder_share=share))
    assert ("encoder_eccentricity", wrong.joint) in names(diagnosis)[:1]
    n_blunders = share * len(diagnosis.choosing)
    assert 0.4 * n_blunders < diagnosis.excluded.sum() < 1.2 * n_blunders + 2


def test_blunders_alone_are_no_effect():
    diagnosis = decided(measured_with(seed=6, blunder_share=0.05))
    assert diagnosis.verdict == "clean"
    assert diagnosis.excluded.sum() > 3


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "share"), [(2, 0.4), (3, 0.5)])
def test_slow_noise_is_no_drift_jump_or_curve(seed, share):
    diagnosis = decided(measured_with(seed=seed, serial_share=share))
    assert diagnosis.verdict == "clean"
    assert diagnosis.noise.serial_share > 0.1
    assert diagnosis.noise.serial_phi > 0.6


@pytest.mark.slow
def test_an_effect_is_found_in_slow_noise():
    wrong = hidden("backlash", 20.0)
    diagnosis = decided(measured_with(wrong, serial_share=0.4))
    assert names(diagnosis) == [("backlash", wrong.joint)]
    assert diagnosis.noise.serial_share > 0.1


@pytest.mark.slow
def test_a_campaign_of_times_and_angles_alone_is_diagnosed():
    wrong = hidden("encoder_eccentricity", 20.0)
    campaign = measured_with(wrong)
    bare = replace(
        campaign.poses,
        temperature_c=None,
        joint_temperatures_c=None,
        approaches=None,
        speeds_rad_s=None,
        directions=None,
        force_n=None,
    )
    diagnosis = decided(replace(campaign, poses=bare, start_utc=None), OPTIONS)
    assert ("encoder_eccentricity", wrong.joint) in names(diagnosis)
    reasons = {
        size.candidate.kind: size.why for size in diagnosis.detectable if size.why
    }
    assert {"thermal_expansion", "backlash", "encoder_latency"} <= set(reasons)
    assert "no temperature" in reasons["thermal_expansion"]


@pytest.mark.slow
def test_an_effect_that_the_arm_has_already_is_no_finding():
    diagnosis = eccentric()
    entry = diagnosis.terms[0].effect
    arm = with_effects(diagnosis.arm, (entry,))
    again = diagnose(diagnosis.campaign, arm, replace(DECISION, seed=3))
    assert again.verdict == "clean"
    (kept,) = again.adapted.effects
    assert kept.kind == "encoder_eccentricity"
    for key in ("cos_rad", "sin_rad"):
        std = diagnosis.terms[0].parameters[key].std
        assert abs(kept.values[key] - entry.values[key]) < 3.0 * std


def two_wrong():
    return hidden("encoder_eccentricity", 20.0), hidden("backlash", 20.0)


@cache
def first_of_two(wished):
    """One term of a campaign with two effects, taken in or not."""
    options = replace(OPTIONS, most_terms=1, accept_tentative=wished)
    return decided(measured_with(*two_wrong()), options)


@pytest.mark.slow
def test_two_effects_are_found_one_after_the_other():
    diagnosis = decided(measured_with(*two_wrong()), OPTIONS)
    assert {name[0] for name in names(diagnosis)} == {
        wrong.kind for wrong in two_wrong()
    }
    s = [step.held_out.chi2 for step in diagnosis.ledger]
    assert s[0] > s[1] > s[2]
    # A decision alone says the same terms, of the ledger the ends only.
    quick = decided(measured_with(*two_wrong()))
    assert names(quick) == names(diagnosis)
    assert [t.status for t in quick.terms] == [t.status for t in diagnosis.terms]
    assert quick.detectable == ()
    assert all(term.separate_by == "" for term in quick.terms)
    first, last = quick.ledger
    assert first.held_out.chi2 == pytest.approx(s[0])
    assert last.held_out.chi2 == pytest.approx(s[2])
    assert last.effect == ", ".join(step.effect for step in diagnosis.ledger[1:])


@pytest.mark.slow
@pytest.mark.parametrize("wished", [False, True])
def test_tentative_terms_enter_only_where_wished(wished):
    diagnosis = first_of_two(wished)
    assert len(diagnosis.terms) == 1
    assert len(diagnosis.ledger) == 2
    # Something is left, so the one name is not sure.
    assert diagnosis.verdict == "tentative"
    assert diagnosis.terms[0].accepted == wished
    assert len(diagnosis.adapted.effects) == int(wished)


@pytest.mark.slow
def test_what_makes_unseen_poses_worse_stays_out():
    # The effect is in the poses for choosing only: no model of it predicts the rest.
    plain, spoilt = measured_with(), measured_with(hidden("encoder_scale", 25.0))
    _, held_out = split(plain, DECISION.seed)
    angles_rad = spoilt.poses.angles_rad.copy()
    angles_rad[held_out] = plain.poses.angles_rad[held_out]
    campaign = plain.with_poses(angles_rad=angles_rad)
    diagnosis = decided(campaign, OPTIONS)
    assert np.array_equal(diagnosis.held_out, held_out)
    assert diagnosis.vetoed
    assert names(diagnosis)[0][0] == "encoder_scale"
    assert not any(term.accepted for term in diagnosis.terms)
    assert diagnosis.adapted.effects == ()
    assert diagnosis.ledger[-1].held_out.chi2 > diagnosis.ledger[0].held_out.chi2


def test_a_model_that_fits_its_own_poses_alone_is_not_clean():
    # The effect is in the poses kept aside only: nothing in the others shows it.
    plain, spoilt = measured_with(), measured_with(hidden("encoder_scale", 60.0))
    _, held_out = split(plain, DECISION.seed)
    angles_rad = plain.poses.angles_rad.copy()
    angles_rad[held_out] = spoilt.poses.angles_rad[held_out]
    campaign = plain.with_poses(angles_rad=angles_rad)
    diagnosis = decided(campaign)
    assert diagnosis.verdict == "unknown"
    (term,) = diagnosis.terms
    assert term.misfit.figures.chi2 > 5.0
    assert term.misfit.figures.n_poses == diagnosis.gap.before.n_poses == held_out.sum()
    assert term.candidate.artefact in {artefact.id for artefact in campaign.artefacts}
    values = diagnosis_json(diagnosis)
    assert values["gap"]["held_out_chi2"]["before"] == pytest.approx(
        term.misfit.figures.chi2
    )
    (line,) = WORDS.lines("missing", diagnosis)
    assert "no others. The poses kept aside are" in line
    assert f"of {held_out.sum()} contradict it one by one" in line


@pytest.mark.slow
@pytest.mark.parametrize("wished", [False, True])
def test_the_gap_is_that_of_the_arm_that_is_written(wished):
    diagnosis = first_of_two(wished)
    start, last = (step.held_out for step in diagnosis.ledger)
    values = diagnosis_json(diagnosis)["gap"]
    words = WORDS.held_out(diagnosis)
    if wished:
        assert diagnosis.gap.after.chi2 == pytest.approx(last.chi2)
        assert "with_all_terms" not in values
        assert " -> " in words
    else:
        assert diagnosis.gap.after == diagnosis.gap.before
        assert values["held_out_chi2"]["after"] == pytest.approx(start.chi2)
        assert values["with_all_terms"]["held_out_chi2"]["after"] == last.chi2
        assert "that is not written included" in words


def test_progress_rises_and_equal_seeds_decide_equally():
    progress = []
    measurement = measured()
    again = diagnose(
        measurement.campaign,
        measurement.arm,
        diagnosed.DECISION,
        lambda _, part: progress.append(part),
    )
    assert again.leftovers == clean().leftovers
    assert np.array_equal(again.held_out, clean().held_out)
    assert progress == sorted(progress)
    assert 0.0 < progress[0] < progress[-1] < 1.0


@pytest.mark.slow
def test_an_effect_that_no_machine_has_is_not_named():
    """3 mm of runout, where 0.01 mm is plausible."""
    table = {
        "kind": "axis_runout",
        "joint": "J3",
        "component": "radial",
        "order": 2,
        "cos_mm": [0.0, 3.0, 0.0],
        "sin_mm": [0.0, 0.0, 2.0],
    }
    made = measured().with_effect(effect_from_table(table))
    diagnosis = diagnose(made.campaign, made.arm, DECISION)
    assert diagnosis.verdict == "unknown"
    oversized = [term for term in diagnosis.terms if term.oversized]
    assert oversized
    for term in oversized:
        assert (term.status, term.accepted) == ("unknown", False)
    words = " ".join(summary_lines(diagnosis))
    assert "larger than in any such machine" in words
    assert [t["oversized"] for t in diagnosis_json(diagnosis)["terms"]].count(True)


def test_poses_that_could_show_nothing_are_not_called_clean():
    true = disturbed(seven_joints(), 3, 20.0, 0.1)
    rng = np.random.default_rng(3)
    angles_rad = true.zeros_rad + rng.uniform(-0.7, 0.7, (14, 7))
    seen_mm = true.centres(angles_rad) + 3.0 * rng.normal(size=(14, 3))
    campaign = seen_places(angles_rad, seen_mm)
    diagnosis = diagnose(campaign, arm_value(seven_joints()), DECISION)
    assert not diagnosis.terms
    assert (diagnosis.blind, diagnosis.verdict) == (True, "unknown")
    assert diagnosis_json(diagnosis)["visible"]["n"] == 0
    words = " ".join(summary_lines(diagnosis))
    assert "No effect of the library could have been seen in 14 poses" in words
    assert "Clean" not in words


@pytest.mark.slow
def test_whole_artefacts_are_kept_aside_on_request():
    options = replace(DECISION, holdout_by="artefact")
    measurement = eccentric_campaign()
    campaign, arm = measurement.campaign, measurement.arm
    diagnosis = diagnose(campaign, arm, options)
    touched = campaign.poses.artefacts
    aside = np.unique(touched[diagnosis.held_out])
    assert 0 < len(aside) < len(np.unique(touched))
    assert np.array_equal(diagnosis.held_out, np.isin(touched, aside))
    assert names(diagnosis) == names(eccentric())
    assert diagnosis.gap.closed > 0.8
    with pytest.raises(IdentificationError, match="no artefact of"):
        diagnose(campaign.part(touched == aside[0]), arm, options)


@pytest.mark.slow
@pytest.mark.parametrize("shared_by", ["all", "chosen"])
def test_a_latency_of_all_joints_is_named_beside_one_joints_only_where_proved(
    shared_by,
):
    """The poses kept aside share it, or contradict it."""
    measurement = measured()
    rng = np.random.default_rng(3)
    n_poses = 150
    angles_rad = rng.uniform(-2.0, 2.0, (n_poses, 7))
    speeds_rad_s = 0.3 * rng.normal(size=(n_poses, 7))
    places_mm = probe_centre(geometry_from_arm(measurement.arm), angles_rad)
    places_mm += rng.normal(0.0, 0.01, places_mm.shape)
    plain = campaign_of_places(
        [joint.name for joint in measurement.arm.joints],
        angles_rad,
        places_mm,
        encoder_rad=1e-6,
        contact_mm=0.01,
    )
    held_out = split(plain, DECISION.seed)[1]
    late_s = np.full((n_poses, 7), 2e-4)
    if shared_by == "chosen":
        late_s[held_out] = 0.0
    late_s[:, 3] += 0.015
    late = replace(
        plain.poses,
        angles_rad=angles_rad - late_s * speeds_rad_s,
        speeds_rad_s=speeds_rad_s,
    )
    diagnosis = diagnose(replace(plain, poses=late), measurement.arm, DECISION)
    terms = {
        term.candidate.joint: term
        for term in diagnosis.terms
        if term.candidate.kind == "encoder_latency"
    }
    single, shared = terms["J4"], terms[None]
    proved = shared_by == "all"
    # Poses kept aside that contradict all that was found leave no name certain.
    assert (single.status == "named", single.accepted) == (proved, True)
    assert (shared.status == "named", shared.accepted) == (proved, proved)
    assert (single.candidate in [r.candidate for r in shared.alternatives]) != proved
