"""Whether a name suffices, or a curve of its own kind is left over beside it."""

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import Measurement, arm_with_masses, measured
from tests.lab.diagnosis.report.test_words import candidate
from tests.lab.simulated import bar, cones, disturbed, seven_joints, simulate
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.candidates.candidate_scores import score_candidates
from traverse.lab.diagnosis.diagnose import DiagnosisOptions, diagnose
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.search.naming import leaves_a_curve


def stage_with(*curves):
    measurement = measured()
    for curve in curves:
        measurement = measurement.with_effect(effect_from_table(curve))
    return score_candidates(equations_of(measurement.fit().adjustment), measurement.arm)


def curve(joint, covariate, knots, height_rad):
    values_rad = [0.0, height_rad, -height_rad, height_rad, 0.0]
    return {
        "kind": "empirical",
        "joint": joint,
        "covariate": covariate,
        "knots": knots,
        "values_rad": values_rad,
    }


def test_a_curve_over_the_own_reading_belies_an_eccentricity():
    stage = stage_with(curve("J2", "J2_rad", [-2.0, -1.0, 0.0, 1.0, 2.0], 3e-5))
    assert leaves_a_curve(stage, candidate("encoder_eccentricity", "J2"))
    # What depends on something else, or on nothing of the joint, is not touched.
    assert not leaves_a_curve(stage, candidate("encoder_drift", "J2"))
    assert not leaves_a_curve(stage, candidate("encoder_eccentricity", "J7"))
    assert not leaves_a_curve(stage, candidate("base_drift"))


def test_a_curve_over_time_belies_a_drift():
    times_s = measured().campaign.poses.time_s
    knots = np.linspace(times_s.min(), times_s.max(), 5).tolist()
    stage = stage_with(curve("J4", "time_s", knots, 6e-5))
    assert leaves_a_curve(stage, candidate("encoder_drift", "J4"))
    assert not leaves_a_curve(stage, candidate("encoder_scale", "J2"))


def test_hardly_anything_belies_a_name_where_nothing_is_left():
    stage = stage_with()
    answers = [
        leaves_a_curve(stage, candidate(kind, f"J{joint}"))
        for kind in ("encoder_harmonic", "encoder_drift", "axis_wobble", "axis_runout")
        for joint in range(1, 8)
    ]
    # Each is reported falsely with a probability of a few percent.
    assert sum(answers) <= 4


@pytest.mark.slow
def test_noise_that_looks_like_an_overtone_does_not_belie_a_strong_wave():
    """Of this noise a test of overtones at 2 % finds one, 0.4 % of what J3 explains."""
    truth = disturbed(seven_joints(), 3)
    campaign = simulate(truth, [*cones(3), bar()], 40, 12)
    eccentricity = {"cos_rad": 3e-4, "sin_rad": -1e-4}
    measurement = Measurement(
        arm_with_masses(seven_joints()), truth, campaign
    ).with_effect(
        effect_from_table(
            {"kind": "encoder_eccentricity", "joint": "J3", **eccentricity}
        )
    )
    diagnosis = diagnose(
        measurement.campaign, measurement.arm, DiagnosisOptions(details=False)
    )
    (term,) = diagnosis.terms
    assert term.candidate.name == "encoder_eccentricity J3"
    assert term.harmonic is None
