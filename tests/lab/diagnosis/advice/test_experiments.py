"""Advice: pairs that are alike, and the poses that separate two effects."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from tests.lab.diagnosis.fitted_rows import measured, measured_rows
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.advice.experiments import (
    gain_needed,
    known_pair,
    postures_text,
    separate_by,
)
from traverse.lab.diagnosis.advice.optimal_poses import (
    experiment,
    extended_rows,
    further_contacts,
)
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import ALIAS
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.search.decision import decide
from traverse.lab.outcomes.diagnosis import Alternative


@cache
def bank():
    return library_bank(measured_rows(), measured().arm)


def candidate_of(kind, joint=None, order=None, component=None):
    places = [candidate.identity for candidate in bank().candidates]
    return bank().candidates[places.index((kind, joint, order, component, None))]


def columns_of(rows, candidate):
    names = library_bank(rows, measured().arm)
    at = [candidate.identity for candidate in names.candidates].index(
        candidate.identity
    )
    return names.columns[:, names.slices[at]]


def pair(first, second):
    return known_pair(candidate_of(*first), candidate_of(*second), measured_rows())


ECCENTRIC_6 = ("encoder_eccentricity", "J6")
SECOND_6 = ("encoder_harmonic", "J6", 2)


def test_aliases_are_all_but_the_same():
    assert ALIAS < 0.9996
    assert ALIAS > 0.9994


def test_the_table_knows_pairs_in_either_order():
    mount, bearing = ("mount_compliance",), ("bearing_compliance", "J1")
    assert pair(mount, bearing) == pair(bearing, mount)
    assert pair(mount, bearing).is_structural
    assert "tilted" in pair(mount, bearing).experiment
    # A bearing further out follows other moments.
    assert not pair(mount, ("bearing_compliance", "J2")).is_structural


def test_the_last_joint_needs_a_second_stylus():
    runout = ("axis_runout", "J7", 2, "radial")
    proposed = pair(("encoder_eccentricity", "J7"), runout)
    assert proposed.is_structural
    assert "second stylus" in proposed.experiment
    inner = pair(("encoder_eccentricity", "J3"), ("axis_runout", "J3", 2, "radial"))
    assert not inner.is_structural


def test_the_table_names_the_experiment():
    assert "wider range" in pair(ECCENTRIC_6, SECOND_6).experiment
    warm = pair(("encoder_temperature", "J2"), ("encoder_drift", "J2"))
    assert "up and down" in warm.experiment
    moving = pair(("encoder_latency", "J2"), ("backlash", "J2"))
    assert "two speeds" in moving.experiment
    weight = pair(("joint_compliance", "J2"), ("encoder_eccentricity", "J2"))
    assert "known mass" in weight.experiment
    ball = pair(("probe_radius",), ("stylus_bending",))
    assert "two forces" in ball.experiment
    assert pair(("encoder_scale", "J1"), ("encoder_scale", "J5")) is None


def test_further_contacts_touch_within_the_travelled_ranges():
    adjustment = measured_rows().adjustment
    further = further_contacts(adjustment, 30, 1, np.zeros(7))
    assert len(further) > 60
    campaign = replace(adjustment.network.campaign, poses=further)
    network = replace(
        adjustment.network, campaign=campaign, weights=np.ones(len(further))
    )
    for index, station in enumerate(adjustment.network.stations):
        mine = np.flatnonzero(further.artefacts == station.index)
        moved = replace(
            station, poses=mine, touches=campaign.touches(station.index, mine, 3.0)
        )
        centres_mm = network.centres_mm(moved, adjustment.state.arm)
        # Standards are as warm as in the pose that was taken as a model.
        equations = station.artefact.equations(
            adjustment.state.unknowns[index], centres_mm, moved.touches
        )
        assert np.max(np.abs(equations.misclosures_mm)) < 1e-3
    travelled_rad = measured().campaign.poses.angles_rad
    assert np.all(further.angles_rad >= travelled_rad.min(axis=0))
    assert np.all(further.angles_rad <= travelled_rad.max(axis=0))


@cache
def found_experiment():
    effects = candidate_of(*ECCENTRIC_6), candidate_of(*SECOND_6)
    amplitudes = np.array([2e-5, -1e-5])
    proposed = experiment(
        effects, amplitudes, measured_rows(), measured().arm, gains=[6.0], n_most=12
    )
    assert proposed is not None
    return effects, amplitudes, proposed


def test_the_separation_is_that_of_all_equations_together():
    effects, amplitudes, proposed = found_experiment()
    rows = extended_rows(measured_rows().adjustment, proposed.poses)
    signal = columns_of(rows, effects[0]) @ (amplitudes / effects[0].scales)
    signal = rows.project(signal[:, np.newaxis])
    other = rows.project(columns_of(rows, effects[1]))
    left = signal - other @ np.linalg.lstsq(other, signal, rcond=None)[0]
    assert proposed.separations[-1, 0] == pytest.approx(
        float(np.sum(left**2)), rel=0.01
    )
    chance = stats.norm.cdf(-0.5 * np.linalg.norm(left))
    assert proposed.chances[-1, 0] == pytest.approx(chance, rel=0.05)


def test_every_chosen_pose_helps_and_more_than_poses_at_random():
    _, _, proposed = found_experiment()
    n = len(proposed.poses)
    assert np.all(np.diff(proposed.separations[:, 0]) > 0.0)
    growth = float(proposed.separations[-1, 0] - proposed.separations[0, 0])
    assert proposed.is_enough == (growth >= 6.0)
    assert proposed.is_enough or n == 12
    # An earlier pose gained the mean; a chosen one gains a multiple of it.
    so_far = float(proposed.separations[0, 0]) / len(measured().campaign.poses)
    assert growth > 2.0 * n * so_far


def test_a_curve_without_a_name_has_no_columns_at_other_poses():
    rows, arm = measured_rows(), measured().arm
    step = replace(
        candidate_of("encoder_drift", "J2"), kind="count_slip", joint="J9", at_s=None
    )
    effects = candidate_of(*ECCENTRIC_6), step
    assert experiment(effects, np.array([2e-5, -1e-5]), rows, arm, gains=[6.0]) is None


def test_the_gain_that_is_needed_settles_nine_of_ten():
    for ahead in (-3.0, 0.0, 2.0):
        gain = gain_needed(ahead)
        # Evidence grows by gain / 2 with the standard deviation sqrt(gain).
        lacking = np.log(100.0) - ahead
        settled = stats.norm.cdf((0.5 * gain - lacking) / np.sqrt(gain))
        assert settled == pytest.approx(0.9, abs=0.001)


def test_where_chosen_poses_lie_is_said_by_the_joint_that_matters():
    campaign = measured().campaign
    angles_rad = campaign.poses.angles_rad
    chosen_rad = np.tile(np.median(angles_rad, axis=0), (10, 1))
    chosen_rad[:, 3] = angles_rad[:, 3].max() - 0.01
    assert postures_text(chosen_rad, campaign, ("J4",)).startswith("with J4 above")
    chosen_rad[:, 3] = angles_rad[:, 3].max() + 0.2
    assert "beyond what it has travelled" in postures_text(
        chosen_rad, campaign, ("J4",)
    )
    chosen_rad[:, 3] = np.median(angles_rad[:, 3])
    assert "all over" in postures_text(chosen_rad, campaign, ("J4",))


@pytest.mark.slow
def test_a_finding_with_an_alias_is_reported_so_without_a_number_of_poses():
    of = measured().with_effect(
        effect_from_table(
            {
                "kind": "encoder_eccentricity",
                "joint": "J7",
                "cos_rad": 1.5e-4,
                "sin_rad": -1e-4,
            }
        )
    )
    everyone = np.ones(len(of.campaign.poses), dtype=np.bool_)
    decision = decide(of.campaign, of.arm, everyone, DiagnosisOptions(n_draws=200))
    naming = decision.names[0]
    search = decision.search
    advice = separate_by(naming, search.stage.rows, search.fit.arm)
    assert "aliases by structure" in advice
    assert "second stylus" in advice
    assert "more pose" not in advice
    alone = replace(naming, alternatives=())
    assert not separate_by(alone, search.stage.rows, search.fit.arm)


def test_all_rivals_are_separated_at_once():
    effects = (
        candidate_of(*ECCENTRIC_6),
        candidate_of(*SECOND_6),
        candidate_of("encoder_scale", "J6"),
    )
    proposed = experiment(
        effects,
        np.array([2e-5, -1e-5]),
        measured_rows(),
        measured().arm,
        gains=[3.0, 3.0],
        n_most=30,
    )
    assert proposed is not None
    assert proposed.separations.shape == (len(proposed.poses) + 1, 2)
    assert np.all(proposed.separations[-1] - proposed.separations[0] >= 3.0)
    assert len(proposed.poses) >= 5


@pytest.mark.slow
def test_a_curve_is_no_alias_by_structure():
    of = measured().with_effect(
        effect_from_table(
            {
                "kind": "encoder_harmonic",
                "joint": "J3",
                "order": 2,
                "cos_rad": 3e-5,
                "sin_rad": 0.0,
            }
        )
    )
    everyone = np.ones(len(of.campaign.poses), dtype=np.bool_)
    decision = decide(of.campaign, of.arm, everyone, DiagnosisOptions(n_draws=200))
    naming = decision.names[0]
    curve = replace(naming.choice.candidate, kind="empirical", covariate="J3_rad")
    naming = replace(
        naming, alternatives=(Alternative(curve, 1.0, correlation=1.0, alias=True),)
    )
    search = decision.search
    advice = separate_by(naming, search.stage.rows, search.fit.arm)
    assert "structure" not in advice
    assert "whole range of J3_rad" in advice
