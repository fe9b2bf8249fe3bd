"""The gap on poses kept aside, against dense formulas."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import measured
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.adjustment import Noise
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.holdout.comparison import (
    compare_on_holdout,
    find_misfit,
    held_out_blunders,
    is_worse,
)
from traverse.lab.diagnosis.model.fit import fitted, with_effects
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.model.result import closed

ECCENTRIC = effect_from_table(
    {"kind": "encoder_eccentricity", "joint": "J3", "cos_rad": 4e-5, "sin_rad": -2e-5}
)


@cache
def fit_of(eccentric: bool, term: bool):
    """Fit the choosing poses; the arm may have an eccentricity, the model a term."""
    of = measured().with_effect(ECCENTRIC) if eccentric else measured()
    choosing, held_out = split(of.campaign, 1)
    terms = (ECCENTRIC,) if term else ()
    return fitted(of.campaign, with_effects(of.arm, terms), choosing), held_out


def holdout_result(fit, held_out, noise=None):
    return compare_on_holdout(fit, fit, held_out, noise=noise).after


def test_the_closed_part_by_hand():
    assert closed(5.1, 1.02, 300) == pytest.approx(4.08 / 4.1)
    assert closed(2.0, 2.5, 300) == pytest.approx(-0.5)
    # 3 sqrt(2 / 200) = 0.3
    assert closed(1.299, 1.0, 200) is None
    assert closed(1.301, 1.0, 200) is not None
    assert closed(float("nan"), float("nan"), 0) is None


def test_the_paired_test_by_hand():
    before = np.array([1.0, 2.0, 3.0, 4.0, np.nan])
    degrees = np.full(5, 3.0)
    # Growths 1, 2, 1, 2: mean 1.5, error 0.2887, t = 5.196; 4.541 is the 1 % point.
    after = before + np.array([1.0, 2.0, 1.0, 2.0, 0.0])
    assert is_worse(before, after, degrees)
    # Growths 0, 2, 0, 2: t = 1.73.
    after = before + np.array([0.0, 2.0, 0.0, 2.0, 0.0])
    assert not is_worse(before, after, degrees)
    assert not is_worse(after, before, degrees)
    assert not is_worse(before, before, degrees)


def test_statistics_are_those_of_the_dense_predictive_covariance():
    fit, held_out = fit_of(eccentric=False, term=False)
    adjustment = fit.adjustment
    columns = equations_of(adjustment).columns
    cofactors = np.linalg.pinv(columns.T @ columns, rcond=1e-13, hermitian=True)
    prediction = adjustment.predicted(held_out)
    network, state = adjustment.network, adjustment.state
    n_free = network.parameters.n_free
    first = n_free
    for index, station in enumerate(network.stations_of(held_out)):
        of_station = slice(first, first + len(station.scales))
        first = of_station.stop
        unknowns = state.unknowns[index]
        for rows in network.white_rows(station, state.arm, unknowns):
            for pose in range(0, len(station.poses), 5):
                full = np.zeros((rows.misclosures.shape[1], len(cofactors)))
                full[:, :n_free] = (
                    rows.by_parameters[pose] * network.parameters.free_tolerances
                )
                full[:, of_station] = rows.by_unknowns[pose] * station.scales
                covariance = np.eye(len(full)) + full @ cofactors @ full.T
                v = rows.misclosures[pose]
                assert prediction.statistics[station.poses[pose]] == pytest.approx(
                    v @ np.linalg.solve(covariance, v), rel=1e-4
                )


def test_s_of_a_right_model_is_one():
    fit, held_out = fit_of(eccentric=False, term=False)
    result = holdout_result(fit.adjustment, held_out)
    assert result.n == 3 * 48 + 24
    assert result.chi2 == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / result.n))
    misclosures_mm = fit.adjustment.predicted(held_out).misclosures_mm
    finite = misclosures_mm[np.isfinite(misclosures_mm)]
    assert result.rms_mm == pytest.approx(np.sqrt(np.mean(finite**2)))
    assert result.mean_distance_mm is None


def test_the_missing_term_closes_the_gap():
    before, held_out = fit_of(eccentric=True, term=False)
    after, _ = fit_of(eccentric=True, term=True)
    gap = compare_on_holdout(before.adjustment, after.adjustment, held_out)
    assert gap.before.chi2 > 2.0
    assert gap.closed == pytest.approx(1.0, abs=0.2)
    assert not gap.is_worse
    assert gap.after.n_poses == np.count_nonzero(held_out)
    assert gap.after.without_blunders is None
    back = compare_on_holdout(after.adjustment, before.adjustment, held_out)
    assert back.is_worse


def test_a_needless_term_brings_no_veto():
    before, held_out = fit_of(eccentric=False, term=False)
    after, _ = fit_of(eccentric=False, term=True)
    gap = compare_on_holdout(before.adjustment, after.adjustment, held_out)
    assert not gap.is_worse
    assert gap.closed is None


def with_blunders(count):
    """Disturb some of the held-out poses; return the measurement and which."""
    of = measured().with_effect(ECCENTRIC)
    _, held_out = split(of.campaign, 1)
    bad = np.flatnonzero(held_out)[:: np.count_nonzero(held_out) // count][:count]
    angles_rad = of.campaign.poses.angles_rad.copy()
    angles_rad[bad, 1] += 5e-4
    return of.with_poses(angles_rad=angles_rad), bad


def test_blunders_are_counted_and_left_out_only_beside():
    of, bad = with_blunders(2)
    choosing, held_out = split(of.campaign, 1)
    before = fitted(of.campaign, of.arm, choosing).adjustment
    after = fitted(of.campaign, with_effects(of.arm, (ECCENTRIC,)), choosing).adjustment
    blunders = held_out_blunders(before, held_out)
    assert np.flatnonzero(blunders).tolist() == bad.tolist()
    gap = compare_on_holdout(before, after, held_out, blunders=blunders)
    assert gap.after.n_poses == np.count_nonzero(held_out)
    assert gap.after.chi2 > 5.0
    assert gap.closed < 0.6
    others_alone = gap.after.without_blunders
    assert others_alone.n_poses == np.count_nonzero(held_out) - 2
    assert others_alone.without_blunders is None
    assert others_alone.rms_mm < gap.after.rms_mm
    part = closed(gap.before.without_blunders.chi2, others_alone.chi2, others_alone.n)
    assert part == pytest.approx(1.0, abs=0.2)
    assert find_misfit(after, held_out, blunders) is None


def test_too_many_contradictions_are_no_blunders():
    of, bad = with_blunders(20)
    choosing, held_out = split(of.campaign, 1)
    model = fitted(of.campaign, with_effects(of.arm, (ECCENTRIC,)), choosing).adjustment
    blunders = held_out_blunders(model, held_out)
    assert not np.any(blunders)
    misfit = find_misfit(model, held_out, blunders)
    assert misfit.figures.chi2 > 5.0
    assert misfit.n_contradicting == len(bad)
    assert misfit.figures.n_poses == np.count_nonzero(held_out)


def test_an_artefact_that_is_held_out_whole_is_predicted_but_for_its_place():
    # Three cones, one after the other, so that scatter averages out.
    statistics, degrees = 0.0, 0.0
    of = measured()
    for index in range(4):
        at_artefact = of.campaign.poses.artefacts == index
        fit = fitted(of.campaign, of.arm, ~at_artefact)
        prediction = fit.adjustment.predicted(at_artefact)
        assert np.sum(prediction.degrees[at_artefact]) == pytest.approx(3 * 40 - 3)
        assert np.all(np.isnan(prediction.statistics[~at_artefact]))
        statistics += float(np.sum(prediction.statistics[at_artefact]))
        degrees += float(np.sum(prediction.degrees[at_artefact]))
    assert statistics / degrees == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / degrees))


def test_more_noise_makes_the_same_misclosures_smaller():
    fit, held_out = fit_of(eccentric=False, term=False)
    noise = fit.adjustment.network.noise
    doubled = Noise(2.0 * noise.encoder_rad, 2.0 * noise.contact_mm)
    of_cones = held_out & (measured().campaign.poses.artefacts < 4)
    plain = holdout_result(fit.adjustment, of_cones)
    weighed = holdout_result(fit.adjustment, of_cones, doubled)
    # Certificates keep their own noise: a quarter, nearly.
    assert weighed.chi2 == pytest.approx(0.25 * plain.chi2, rel=0.01)
    assert weighed.rms_mm == plain.rms_mm
    again = fit.adjustment.with_noise(doubled).with_noise(noise)
    assert holdout_result(again, of_cones).chi2 == pytest.approx(plain.chi2)


def test_without_held_out_poses_there_is_nothing_to_say():
    fit, held_out = fit_of(eccentric=False, term=False)
    gap = compare_on_holdout(fit.adjustment, fit.adjustment, np.zeros_like(held_out))
    assert gap.before.n == 0
    assert np.isnan(gap.before.rms_mm)
    assert gap.closed is None
    assert not gap.is_worse


def test_mean_distances_are_reported_for_known_points():
    fit, held_out = fit_of(eccentric=False, term=False)
    network = fit.adjustment.network
    artefacts = network.campaign.artefacts
    named = artefacts[0].model_copy(update={"kind": "points"})
    campaign = replace(network.campaign, artefacts=(named, *artefacts[1:]))
    adjustment = replace(fit.adjustment, network=replace(network, campaign=campaign))
    result = holdout_result(adjustment, held_out)
    mine = held_out & (campaign.poses.artefacts == 0)
    misclosures_mm = adjustment.predicted(mine).misclosures_mm[mine]
    expected_mm = np.mean(np.sqrt(np.sum(misclosures_mm**2, axis=1)))
    assert result.mean_distance_mm == pytest.approx(expected_mm)
