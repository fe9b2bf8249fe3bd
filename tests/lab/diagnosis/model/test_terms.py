"""Terms of a fit one by one: taken out, and their standard deviations."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from scipy import stats

from benchmarks.tools.handover import campaign_from_simulation
from tests.lab.diagnosis.fitted_rows import measured
from tests.simulator.effects.examples import heavy_arm, spec_of
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import judge, project
from traverse.lab.diagnosis.model.fit import (
    estimates_of,
    fitted,
    rows_without,
    with_effects,
)
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.model.serial_noise import (
    SerialCorrelation,
    without_serial_noise,
)
from traverse.lab.outcomes.candidate import BankName
from traverse.simulator.campaigns import (
    BallBar,
    Cone,
    NoiseTable,
    draw_noise,
    make_poses,
)
from traverse.simulator.campaigns import with_effects as touched_with

START = datetime(2000, 1, 1, tzinfo=UTC)  # of a campaign that states none
ECCENTRICITY = {
    "kind": "encoder_eccentricity",
    "joint": "J3",
    "cos_rad": 3e-5,
    "sin_rad": -1e-5,
}
DRIFT = {"kind": "base_drift", "rate_mm_s": [3e-5, 0.0, -2e-5], "epoch_utc": START}
STEP = {
    "kind": "base_step",
    "at_s": 500.0,
    "step_mm": [0.02, -0.01, 0.0],
    "epoch_utc": START,
}
WOBBLE = {
    "kind": "axis_wobble",
    "joint": "J4",
    "order": 2,
    "cos_rad": [2e-5, 0.0, 0.0],
    "sin_rad": [0.0, 0.0, -3e-5],
}
LOBING = {"kind": "probe_lobing", "amplitude_mm": 0.008, "phase_rad": 0.6}
COMPLIANCE = {"kind": "bearing_compliance", "joint": "J2", "compliance_rad_nm": 1e-5}


@cache
def fit_with(*tables):
    """A fit with some effects of a campaign in which there are these."""
    effects = tuple(effect_from_table(dict(table)) for table in tables)
    measurement = measured()
    for effect in effects:
        measurement = measurement.with_effect(effect)
    return measurement, measurement.fit(effects)


def frozen(table):
    return tuple(
        (key, tuple(value) if isinstance(value, list) else value)
        for key, value in table.items()
    )


@pytest.mark.parametrize(
    "table",
    [ECCENTRICITY, DRIFT, STEP, WOBBLE, LOBING, COMPLIANCE],
    ids=lambda t: t["kind"],
)
def test_a_term_taken_out_leaves_the_rows_of_a_fit_without_it(table):
    measurement, fit = fit_with(frozen(table))
    with_term, plain = equations_of(fit.adjustment), measurement.fit()
    left, expected = rows_without(with_term, 0), equations_of(plain.adjustment)
    if np.array_equal(fit.included, plain.included):
        assert left.redundancy == expected.redundancy
        changed = np.abs(expected.residuals - with_term.residuals).max()
        np.testing.assert_allclose(
            left.residuals, expected.residuals, atol=0.03 * changed + 0.02
        )
    assert left.sum_of_squares == pytest.approx(expected.sum_of_squares, rel=0.02)


def test_the_other_term_stays():
    measurement, fit = fit_with(frozen(ECCENTRICITY), frozen(DRIFT))
    rows = equations_of(fit.adjustment)
    effects = tuple(effect_from_table(t) for t in (ECCENTRICITY, DRIFT))
    for index in (0, 1):
        expected = equations_of(measurement.fit((effects[1 - index],)).adjustment)
        left = rows_without(rows, index)
        assert left.redundancy == expected.redundancy
        np.testing.assert_allclose(left.residuals, expected.residuals, atol=0.05)


def test_a_term_taken_out_is_found_again_with_its_size():
    measurement, fit = fit_with(frozen(ECCENTRICITY), frozen(DRIFT))
    rows = rows_without(equations_of(fit.adjustment), 0)
    scores = judge(rows, project(rows, library_bank(rows, measurement.arm)))
    best = scores.projected[int(np.argmax(scores.scores))]
    assert best.candidate.name == "encoder_eccentricity J3"
    assert best.candidate.bank is BankName.LIBRARY
    amplitudes, covariance = best.amplitudes(rows.residuals)
    estimates = estimates_of(equations_of(fit.adjustment), 0)
    for index, key in enumerate(("cos_rad", "sin_rad")):
        assert amplitudes[index] == pytest.approx(estimates[key].value, abs=2e-7)
        assert covariance[index, index] ** 0.5 == pytest.approx(
            estimates[key].std, rel=0.1
        )


@pytest.mark.parametrize(
    "table", [ECCENTRICITY, DRIFT, WOBBLE, COMPLIANCE], ids=lambda t: t["kind"]
)
def test_standard_deviations_are_those_of_the_adjustment(table):
    _, fit = fit_with(frozen(table))
    adjustment = fit.adjustment
    parameters = adjustment.network.parameters
    directions = parameters.effects.directions(adjustment.state.arm.geometry)
    inverse = adjustment.split.inverse[-directions.shape[1] :]
    stds = adjustment.sigma0 * np.linalg.norm(directions @ inverse, axis=1)
    estimates = estimates_of(equations_of(adjustment), 0)
    reported_stds = np.concatenate(
        [np.atleast_1d(estimate.std) for estimate in estimates.values()]
    )
    np.testing.assert_allclose(reported_stds, stds, rtol=0.02, atol=1e-3 * stds.max())


def test_without_any_length_misclosures_say_nothing_of_it():
    """They grow with the arm: a column of its length would explain all of them."""
    measurement = measured().with_effect(effect_from_table(dict(ECCENTRICITY)))
    campaign = measurement.campaign
    kinds = np.array([artefact.kind for artefact in campaign.artefacts])
    on_cones = kinds[campaign.poses.artefacts] == "cone"
    # Stated noise that is too small makes misclosures as large as many poses do.
    campaign = replace(campaign.part(on_cones), encoder_rad=2e-7, contact_mm=1e-4)
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    arm = with_effects(measurement.arm, (effect_from_table(dict(ECCENTRICITY)),))
    adjustment = fitted(campaign, arm, everyone, snooping=False).adjustment
    assert not adjustment.network.has_length()
    rows = equations_of(adjustment)
    assert rows.redundancy == adjustment.redundancy
    assert rows.sum_of_squares == pytest.approx(adjustment.system.sum_of_squares)
    inverse = adjustment.split.inverse[-2:]
    stds = adjustment.sigma0 * np.linalg.norm(inverse, axis=1)
    estimates = estimates_of(rows, 0)
    np.testing.assert_allclose(
        [estimate.std for estimate in estimates.values()], stds, rtol=1e-3
    )


def test_estimates_have_the_keys_and_units_of_the_arm_file():
    _, fit = fit_with(frozen(WOBBLE))
    estimates = estimates_of(equations_of(fit.adjustment), 0)
    assert {key: estimate.unit for key, estimate in estimates.items()} == {
        "cos_rad": "rad",
        "sin_rad": "rad",
    }
    axis = fit.adjustment.state.arm.geometry.axes[3]
    for estimate in estimates.values():
        assert np.shape(estimate.value) == np.shape(estimate.std) == (3,)
        assert np.dot(estimate.value, axis) == pytest.approx(0.0, abs=1e-12)
    assert fit.arm.effects[0].values["cos_rad"] == estimates["cos_rad"].value


def test_slow_noise_widens_what_is_slow():
    _, fit = fit_with(frozen(ECCENTRICITY), frozen(DRIFT))
    rows = equations_of(fit.adjustment)
    slow = without_serial_noise(rows, SerialCorrelation(0.5, 0.95))
    plain, wide = (
        np.linalg.norm(estimates_of(equations, 1)["rate_mm_s"].std)
        for equations in (rows, slow)
    )
    assert wide > 1.5 * plain
    fast = [estimates_of(equations, 0)["cos_rad"].std for equations in (rows, slow)]
    assert fast[1] < 1.2 * fast[0]


def test_without_effects_there_is_nothing_to_take_out():
    rows = measured().rows()
    with pytest.raises(ValueError, match="no effects"):
        rows_without(rows, 0)
    with pytest.raises(ValueError, match="no effects"):
        estimates_of(rows, 0)


def test_estimates_scatter_as_much_as_they_say():
    """Effects of the simulator's physics, noise drawn many times."""
    tables = (
        ECCENTRICITY,
        {**DRIFT, "rate_mm_s": [1e-4, -5e-5, 2e-5]},
        {"kind": "thermal_expansion", "expansion_per_c": 1e-5},
    )
    bar = BallBar(
        id="bar", n_poses=40, radius_mm=12.7, distance_mm=400.0, distance_std_mm=5e-4
    )
    spec = spec_of(*(Cone(id=f"cone-{n}", n_poses=40) for n in (1, 2, 3)), bar)
    arm = heavy_arm()
    start = spec.conditions.start_utc
    effects = tuple(
        effect_from_table({**t, "epoch_utc": start} if "epoch_utc" in t else t)
        for t in tables
    )
    noise = NoiseTable(encoder_rad=5e-6, contact_mm=0.003)
    poses = touched_with(make_poses(arm, spec, 5), effects)
    deviations, before = [], None
    for seed in range(15):
        campaign = campaign_from_simulation(draw_noise(poses, seed, noise).campaign)
        everyone = np.ones(len(campaign.poses), dtype=np.bool_)
        start_arm = with_effects(arm, effects) if before is None else before.arm
        before = fitted(campaign, start_arm, everyone)
        rows = equations_of(before.adjustment)
        for index, effect in enumerate(effects):
            for key, estimate in estimates_of(rows, index).items():
                away = np.subtract(estimate.value, effect.values[key]) / np.array(
                    estimate.std
                )
                deviations += np.atleast_1d(away).tolist()
    n = len(deviations)
    assert n == 15 * 6
    # Not quite independent: keys of one campaign correlate a little.
    squares = float(np.sum(np.square(deviations)))
    assert stats.chi2.ppf(1e-4, n) < squares < stats.chi2.isf(1e-4, n)
