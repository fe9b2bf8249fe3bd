"""Whether a name suffices, or a curve of its own kind is left over beside it."""

import numpy as np

from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.diagnosis.report.test_words import candidate
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.candidates.candidate_scores import score_candidates
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.search.naming import leaves_a_curve

KNOTS = [-2.0, -1.0, 0.0, 1.0, 2.0]


def stage_with(*tables):
    measurement = measured()
    for table in tables:
        measurement = measurement.with_effect(effect_from_table(table))
    return score_candidates(equations_of(measurement.fit().adjustment), measurement.arm)


def test_a_curve_over_the_own_reading_belies_an_eccentricity():
    stage = stage_with(
        {
            "kind": "empirical",
            "joint": "J2",
            "covariate": "J2_rad",
            "knots": KNOTS,
            "values_rad": [0.0, 3e-5, -3e-5, 3e-5, 0.0],
        }
    )
    assert leaves_a_curve(stage, candidate("encoder_eccentricity", "J2"))
    # What depends on something else, or on nothing of the joint, is not touched.
    assert not leaves_a_curve(stage, candidate("encoder_drift", "J2"))
    assert not leaves_a_curve(stage, candidate("encoder_eccentricity", "J7"))
    assert not leaves_a_curve(stage, candidate("base_drift"))


def test_a_curve_over_time_belies_a_drift():
    times_s = measured().campaign.poses.time_s
    knots = np.linspace(times_s.min(), times_s.max(), 5).tolist()
    stage = stage_with(
        {
            "kind": "empirical",
            "joint": "J4",
            "covariate": "time_s",
            "knots": knots,
            "values_rad": [0.0, 6e-5, -6e-5, 6e-5, 0.0],
        }
    )
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
