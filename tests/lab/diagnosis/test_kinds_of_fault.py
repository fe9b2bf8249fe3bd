"""Faults that once passed for clean, for noise or for another effect."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tools.handover import campaign_from_simulation
from tests.lab.diagnosis.diagnosed import DECISION, ECCENTRIC, clean
from tests.lab.diagnosis.engine_campaigns import poses
from tests.lab.diagnosis.fitted_rows import Measurement, measured
from tests.lab.simulated import Noise, arm_value, disturbed, seven_joints, simulate
from traverse.kinematics.arm_file.arm import (
    Identification,
    effect_from_table,
    write_arm,
)
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.adjustment import IdentificationError
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.report.files import (
    covariance_of,
    summary_lines,
    write_diagnosis,
)
from traverse.lab.diagnosis.report.outcome import outcome_of
from traverse.lab.diagnosis.search.decision import decide
from traverse.lab.outcomes.base import State
from traverse.simulator.campaigns import draw_noise, with_effects

COARSE = Noise(encoder_rad=5e-4, contact_mm=0.03)
GAUGES = [
    {
        "id": f"gauge-{number}",
        "kind": "seats",
        "distance_mm": 50.0,
        "distance_std_mm": 0.05,
    }
    for number in (1, 2, 3, 4)
]


def moved(measurement: Measurement, moves_mm) -> Measurement:
    """What the ball touches lies elsewhere by that, (n_poses, 3): other readings."""
    angles_rad = measurement.campaign.poses.angles_rad
    slopes = probe_derivatives(measurement.truth.geometry(), angles_rad).by_angles
    steps = np.linalg.pinv(slopes) @ moves_mm[:, :, np.newaxis]
    return measurement.with_poses(angles_rad=angles_rad + steps[:, :, 0])


def scattered(measurement: Measurement, std_rad) -> Measurement:
    """Readings have more noise than stated."""
    angles_rad = measurement.campaign.poses.angles_rad
    noise_rad = np.random.default_rng(5).normal(size=angles_rad.shape) * std_rad
    return measurement.with_poses(angles_rad=angles_rad + noise_rad)


def decided(measurement: Measurement):
    return diagnose(measurement.campaign, measurement.arm, DECISION)


@pytest.mark.slow
def test_an_eccentricity_of_a_coarse_encoder_is_no_torsion():
    """With priors of fine encoders a torsion of odd moments explained it at less."""
    truth = disturbed(seven_joints(), 1)
    campaign = simulate(truth, GAUGES, 50, 1, noise=COARSE)
    table = ECCENTRIC | {"joint": "J2", "cos_rad": 0.008, "sin_rad": -0.005}
    measurement = Measurement(arm_value(seven_joints()), truth, campaign)
    diagnosis = decided(measurement.with_effect(effect_from_table(table)))
    named = [term for term in diagnosis.terms if term.status == "named"]
    assert diagnosis.terms
    assert {(t.candidate.kind, t.candidate.joint) for t in named} <= {
        ("encoder_eccentricity", "J2")
    }
    first = diagnosis.terms[0]
    names = [first.candidate, *(rival.candidate for rival in first.alternatives)]
    assert ("encoder_eccentricity", "J2") in [(c.kind, c.joint) for c in names]


def test_a_base_that_rocks_with_the_approach_is_told_as_that():
    start = measured()
    centres_mm = start.truth.centres(start.campaign.poses.angles_rad)
    approaches = start.campaign.poses.approaches[:, [1]]
    tilts_rad = 8e-5 * approaches * np.array([1.0, 0.4, 0.0])
    diagnosis = decided(moved(start, np.cross(tilts_rad, centres_mm)))
    (term,) = diagnosis.terms
    assert diagnosis.verdict == "unknown"
    assert term.candidate.covariate == "J2_approach"
    assert (term.candidate.joint, term.candidate.component) == ("J1", "tilt")
    assert outcome_of(diagnosis).state is State.BAD


def test_each_of_two_artefacts_that_creep_is_named():
    start = measured()
    touched = start.campaign.poses
    ids = [artefact.id for artefact in start.campaign.artefacts]
    share = touched.time_s / touched.time_s.max()
    moves_mm = np.zeros((len(touched), 3))
    for name, move_mm in (("cone-2", [0.03, -0.04, 0.0]), ("bar", [0.0, 0.03, 0.04])):
        moves_mm += np.outer(share * (touched.artefacts == ids.index(name)), move_mm)
    diagnosis = decided(moved(start, moves_mm))
    named = {term.candidate.artefact for term in diagnosis.terms}
    assert (diagnosis.verdict, named) == ("named", {"cone-2", "bar"})
    assert diagnosis.noise.serial_share == 0.0
    assert diagnosis.adapted.effects == ()
    assert "cone-2 is at fault" in " ".join(outcome_of(diagnosis).sentences)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cones", "lacks"), [([1], ("scale", "reach")), ([0, 1, 2, 3], ("scale",))]
)
def test_an_arm_of_cones_alone_has_no_scale_and_no_file(tmp_path, cones, lacks):
    """Of a single one there is no volume either, which noise could exceed."""
    start = measured()
    on_cones = start.campaign.part(np.isin(start.campaign.poses.artefacts, cones))
    diagnosis = diagnose(on_cones, start.arm, DECISION)
    assert (diagnosis.verdict, diagnosis.terms) == ("clean", ())
    assert outcome_of(diagnosis).codes == lacks
    assert outcome_of(diagnosis).state is State.BAD
    source = tmp_path / "design.toml"
    write_arm(source, start.arm)
    (tmp_path / "arm.toml").write_text("of an earlier diagnosis")
    assert write_diagnosis(tmp_path, diagnosis, source) is None
    assert not (tmp_path / "arm.toml").exists()
    # Its scale came from where the arm was identified.
    made = Identification(sigma0=1.0, redundancy=300)
    identified = start.arm.model_copy(update={"identification": made})
    known = replace(diagnosis, arm=identified)
    assert outcome_of(known).codes == lacks
    assert outcome_of(known).state is State.DOUBT
    assert write_diagnosis(tmp_path, known, source) is not None


def test_an_arm_that_is_far_from_its_design_is_in_doubt():
    """As of an identification: all fits, but a link of the file is 60 mm off."""
    links_mm = clean().design.links_mm.copy()
    links_mm[3] += [0.0, 0.0, 60.0]
    design = replace(clean().design, links_mm=links_mm)
    (reason,) = outcome_of(replace(clean(), design=design)).reasons
    assert (reason.code, reason.state) == ("design", State.DOUBT)
    assert reason.values["parameter"].startswith("J4.link")


def test_a_joint_that_turns_the_other_way_is_found_before_effects_are():
    ring = measured().with_effect(effect_from_table(ECCENTRIC))
    angles_rad = ring.campaign.poses.angles_rad.copy()
    angles_rad[:, 1] *= -1.0
    diagnosis = decided(ring.with_poses(angles_rad=angles_rad))
    assert diagnosis.wrong_signs == ("J2",)
    assert [term.candidate.kind for term in diagnosis.terms] == [ECCENTRIC["kind"]]
    outcome = outcome_of(diagnosis)
    assert (outcome.state, outcome.codes) == (State.DOUBT, ("arm_file",))
    before, after = (arm.joints[1].axis for arm in (ring.arm, diagnosis.adapted))
    assert np.dot(before, after) < -0.99


@pytest.mark.slow
def test_what_fits_nothing_is_refused():
    start = measured()
    angles_rad = start.campaign.poses.angles_rad.copy()
    angles_rad[:, [2, 4]] = angles_rad[:, [4, 2]]
    some = start.with_poses(angles_rad=angles_rad).campaign
    some = some.part(np.arange(len(angles_rad)) % 4 == 0)
    everyone = np.ones(len(some.poses), dtype=np.bool_)
    with pytest.raises(IdentificationError, match="do not belong together"):
        decide(some, start.arm, everyone, DECISION)


@pytest.mark.slow
def test_effects_of_an_arm_that_fits_badly_are_not_listed(tmp_path):
    start = measured()
    spoilt = scattered(start, 0.02).campaign
    some = spoilt.part(np.arange(len(spoilt.poses)) % 2 == 0)
    diagnosis = diagnose(some, start.arm, replace(DECISION, n_draws=50, most_terms=1))
    (term,) = diagnosis.terms
    assert term.misfit is not None
    assert term.misfit.is_gross
    assert outcome_of(diagnosis).state is State.BAD
    assert "fit" in outcome_of(diagnosis).codes
    assert "do not belong together" in " ".join(summary_lines(diagnosis))
    source = tmp_path / "design.toml"
    write_arm(source, start.arm)
    assert write_diagnosis(tmp_path / "out", diagnosis, source) is None


@pytest.mark.slow
def test_noise_that_is_exceeded_without_a_pattern_is_not_clean():
    diagnosis = decided(scattered(measured(), 2e-5))
    assert diagnosis.terms == ()
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.exceeded > 4.0
    outcome = outcome_of(diagnosis)
    assert outcome.state is State.BAD
    (reason,) = [reason for reason in outcome.reasons if reason.code == "within_noise"]
    assert reason.values["times_stated"] == pytest.approx(diagnosis.gap.after.chi2)
    # Nobody knows where none is stated.
    campaign = replace(diagnosis.campaign, encoder_rad=None, contact_mm=None)
    assert diagnose(campaign, measured().arm, DECISION).verdict == "clean"


def test_noise_that_is_exceeded_a_little_is_not_clean_either():
    diagnosis = decided(scattered(measured(), 8e-6))
    assert diagnosis.exceeded is None
    assert 1.5 < diagnosis.gap.after.chi2 < 4.0
    assert (diagnosis.verdict, diagnosis.terms) == ("unexplained", ())
    assert outcome_of(diagnosis).state is State.DOUBT


def test_a_campaign_of_many_blunders_is_not_clean():
    start = measured()
    rng = np.random.default_rng(6)
    angles_rad = start.campaign.poses.angles_rad.copy()
    hit = rng.random(len(angles_rad)) < 0.25
    angles_rad[hit] += rng.normal(size=(int(hit.sum()), 7)) * 2e-4
    diagnosis = decided(start.with_poses(angles_rad=angles_rad))
    assert diagnosis.verdict in ("unexplained", "unknown")
    assert "agreeing" in outcome_of(diagnosis).codes


@pytest.mark.slow
def test_an_eccentric_and_tilted_ring_is_named_by_both():
    travel_rad = np.ptp(measured().campaign.poses.angles_rad[:, 2])
    assert travel_rad > np.radians(270.0)
    twice = {
        "kind": "encoder_harmonic",
        "order": 2,
        "joint": "J3",
        "cos_rad": 2.2e-5,
        "sin_rad": 1.8e-5,
    }
    ring = measured()
    for table in (ECCENTRIC, twice):
        ring = ring.with_effect(effect_from_table(table))
    diagnosis = decided(ring)
    verdicts = [
        (t.status, t.candidate.kind, t.candidate.joint) for t in diagnosis.terms
    ]
    assert sorted(verdicts) == [
        ("named", "encoder_eccentricity", "J3"),
        ("named", "encoder_harmonic", "J3"),
    ]


@pytest.mark.parametrize(
    "table",
    [
        pytest.param(
            {"kind": "joint_compliance", "joint": "J2", "compliance_rad_nm": -4e-6},
            marks=pytest.mark.slow,
        ),
        {"kind": "stylus_bending", "compliance_mm_n": -0.03},
    ],
    ids=lambda table: table["kind"],
)
def test_what_yields_against_weight_or_force_is_no_compliance(table):
    diagnosis = decided(measured().with_effect(effect_from_table(table)))
    (term,) = diagnosis.terms
    assert (term.status, term.negative, term.accepted) == ("unknown", True, False)


@pytest.mark.slow
def test_a_wrong_length_of_the_only_bar_is_no_radius_alone():
    """The arm takes the length up as its scale, and radii look wrong."""
    campaign = campaign_from_simulation(draw_noise(poses(), 1).campaign)
    artefacts = [
        artefact.model_copy(update={"distance_mm": artefact.distance_mm + 0.5})
        if artefact.id == "bar"
        else artefact
        for artefact in campaign.artefacts
    ]
    wrong = replace(campaign, artefacts=tuple(artefacts))
    diagnosis = diagnose(wrong, poses().arm, DECISION)
    (term,) = diagnosis.terms
    names = [term.candidate, *(rival.candidate for rival in term.alternatives)]
    assert {("probe_radius", None), ("artefact_length", "bar")} <= {
        (name.kind, name.artefact) for name in names
    }
    assert "scale" in outcome_of(diagnosis).codes


def test_distances_wrong_by_one_factor_are_rivals_of_the_probes_radius():
    campaign = campaign_from_simulation(draw_noise(poses(two_bars=True), 1).campaign)
    artefacts = [
        artefact.model_copy(update={"distance_mm": 1.0008 * artefact.distance_mm})
        if artefact.kind == "ball_bar"
        else artefact
        for artefact in campaign.artefacts
    ]
    wrong = replace(campaign, artefacts=tuple(artefacts))
    diagnosis = diagnose(wrong, poses().arm, DECISION)
    rivals = [
        rival.candidate.artefact
        for term in diagnosis.terms
        for rival in term.alternatives
    ]
    assert "bar, short" in rivals
    assert "scale" in outcome_of(diagnosis).codes
    # The arm is wrong by as much, and its covariance knows it.
    assert diagnosis.other_scale == pytest.approx(8e-4, rel=0.2)
    longest_mm = np.linalg.norm(diagnosis.adapted.joints[2].link_mm)
    spread_mm = [
        np.sqrt(np.trace(covariance_of(diagnosis.final, part).covariance[21:42, 21:42]))
        for part in (diagnosis.other_scale, 0.0)
    ]
    assert spread_mm[0] > 0.9 * diagnosis.other_scale * longest_mm > spread_mm[1]


@pytest.mark.slow
@pytest.mark.parametrize("force_is_known", [True, False])
def test_contacts_that_give_way_are_no_radius_and_no_stylus_alone(force_is_known):
    """Two operators, of 1 and 4 N, whose contacts yield by 4 um/N."""
    soft, hard = (
        campaign_from_simulation(
            draw_noise(with_effects(poses(), [effect_from_table(table)]), 1).campaign
        )
        for table in (
            {"kind": "probe_radius", "radius_error_mm": -0.004},
            {"kind": "probe_radius", "radius_error_mm": -0.016},
        )
    )
    is_hard = np.arange(len(soft.poses)) % 2 == 1
    angles_rad = np.where(
        is_hard[:, np.newaxis], hard.poses.angles_rad, soft.poses.angles_rad
    )
    force_n = np.where(is_hard, 4.0, 1.0) if force_is_known else None
    both = replace(soft.poses, angles_rad=angles_rad, force_n=force_n)
    diagnosis = diagnose(replace(soft, poses=both), poses().arm, DECISION)
    assert diagnosis.terms
    for term in diagnosis.terms:
        rivals = [(rival.candidate, rival.alias) for rival in term.alternatives]
        (rival,) = [each for each in rivals if each[0].covariate == "force_n"]
        assert rival[0].kind == "probe_radius"
        assert rival[1] is not force_is_known
        assert not (force_is_known and term.status == "named")


@pytest.mark.slow
def test_a_name_is_not_certain_where_much_more_than_the_noise_is_left():
    """A joint is late, and no column says how fast it turned."""
    table = {"kind": "encoder_latency", "joint": "J4", "latency_s": 1e-3}
    late = measured().with_effect(effect_from_table(table))
    diagnosis = decided(late.with_poses(speeds_rad_s=None))
    assert diagnosis.verdict in ("unexplained", "unknown")
    assert diagnosis.exceeded > 3.0
    assert "named" not in [term.status for term in diagnosis.terms]
