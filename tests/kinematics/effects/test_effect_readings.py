"""Each reading kind against its formula, sample by sample, and where it acts."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.kinematics.effects.reference import (
    EPOCH,
    EPOCH_NS,
    T_REF,
    effect,
    random_arm,
    random_readings,
)
from traverse.kinematics.arm_file.arm import Identification
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import angle_corrections, corrected_pose
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_uncertainties,
)

ARM = random_arm(11)
GEOMETRY = geometry_from_arm(ARM)
READINGS = random_readings(12, n_samples=7)


def check(correction, expected, joint=2, arm=ARM, **covariates):
    """Compare d_alpha of J3 with expected(n), and the pose with that of theta."""
    effects = effects_of(arm, (correction,))
    block = Block(READINGS, **covariates)
    corrections_rad = angle_corrections(GEOMETRY, effects, block)
    errors_rad = np.zeros_like(READINGS)
    errors_rad[:, joint] = [expected(n) for n in range(len(READINGS))]
    assert np.abs(errors_rad).max() > 0.0
    np.testing.assert_allclose(corrections_rad, errors_rad, rtol=1e-13, atol=1e-18)
    centres, shanks, _ = corrected_pose(GEOMETRY, effects, block)
    true_centres, true_shanks = probe_pose(GEOMETRY, READINGS - errors_rad)
    np.testing.assert_allclose(centres, true_centres, rtol=0, atol=1e-10)
    np.testing.assert_allclose(shanks, true_shanks, rtol=0, atol=1e-13)


def test_eccentricity_is_once_a_turn_of_the_reading():
    correction = effect(
        "encoder_eccentricity", joint="J3", cos_rad=3e-5, sin_rad=-1.2e-5
    )
    alpha = READINGS[:, 2]
    check(correction, lambda n: 3e-5 * math.cos(alpha[n]) - 1.2e-5 * math.sin(alpha[n]))


def test_harmonic_is_so_many_times_a_turn_of_the_reading():
    correction = effect(
        "encoder_harmonic", joint="J3", order=36, cos_rad=1e-6, sin_rad=2e-6
    )
    phases = 36 * READINGS[:, 2]
    check(correction, lambda n: 1e-6 * math.cos(phases[n]) + 2e-6 * math.sin(phases[n]))


def test_scale_is_in_parts_per_million_of_the_turn_since_the_base_posture():
    correction = effect("encoder_scale", joint="J3", scale_ppm=15.0)
    zero = ARM.joints[2].zero_rad
    check(correction, lambda n: 15e-6 * (READINGS[n, 2] - zero))


def test_temperature_of_the_joint_goes_before_that_of_the_arm():
    correction = effect("encoder_temperature", joint="J3", rate_rad_c=2e-6)
    own_c = np.full(READINGS.shape, np.nan)
    own_c[:3, 2] = [25.0, 18.0, T_REF]
    arm_c = np.full(len(READINGS), 24.5)
    check(
        correction,
        lambda n: 2e-6 * ([25.0, 18.0, T_REF, 24.5, 24.5, 24.5, 24.5][n] - T_REF),
        temperature_c=arm_c,
        joint_temperatures_c=own_c,
    )
    check(correction, lambda n: 2e-6 * (24.5 - T_REF), temperature_c=arm_c)


def test_drift_runs_from_its_epoch_and_is_held_after_the_campaign():
    correction = effect("encoder_drift", joint="J3", rate_rad_s=1e-9, epoch_utc=EPOCH)
    seconds = np.array([-50, 0, 10.5, 100, 3600, 3601, 1e6])
    utc_ns = EPOCH_NS + np.round(seconds * 1e9).astype(np.int64)
    arm = ARM.model_copy(
        update={"identification": Identification(date="2026-11-20T10:00:00Z")}
    )
    held = np.clip(seconds, 0, 3600)
    check(correction, lambda n: 1e-9 * held[n], arm=arm, utc_ns=utc_ns)
    flags = corrected_pose(
        GEOMETRY, effects_of(arm, (correction,)), Block(READINGS, utc_ns=utc_ns)
    )[2]
    outside = [True, False, False, False, False, True, True]
    np.testing.assert_array_equal(flags.stale_effect, outside)


def test_drift_of_a_told_campaign_may_begin_before_its_epoch():
    correction = effect("encoder_drift", joint="J3", rate_rad_s=1e-9, epoch_utc=EPOCH)
    seconds = np.linspace(-400, 200, 7)
    block = Block(READINGS, utc_ns=EPOCH_NS + (seconds * 1e9).astype(np.int64))
    span = (EPOCH.replace(hour=8, minute=55), EPOCH.replace(minute=1))
    effects = effects_of(ARM, (correction,), span)
    corrections_rad = angle_corrections(GEOMETRY, effects, block)[:, 2]
    np.testing.assert_allclose(
        corrections_rad, 1e-9 * np.clip(seconds, -300, 60), rtol=1e-12
    )


def test_drift_of_an_unknown_campaign_is_nothing_but_flagged():
    correction = effect("encoder_drift", joint="J3", rate_rad_s=1e-9, epoch_utc=EPOCH)
    block = Block(READINGS, utc_ns=EPOCH_NS + np.arange(7) * 10**9)
    effects = effects_of(ARM, (correction,))
    assert not angle_corrections(GEOMETRY, effects, block).any()
    flags = corrected_pose(GEOMETRY, effects, block)[2]
    np.testing.assert_array_equal(flags.stale_effect, [False] + 6 * [True])


def test_slip_begins_at_its_moment_and_lasts_without_a_flag():
    correction = effect(
        "count_slip", joint="J3", at_s=2.5, step_rad=7e-5, epoch_utc=EPOCH
    )
    since_ns = np.array([-1, 2_499_999_999, 2_500_000_000, 3, 5, 10**15, 10**17])
    after = since_ns >= 2_500_000_000
    utc_ns = EPOCH_NS + since_ns
    check(correction, lambda n: 7e-5 * after[n], utc_ns=utc_ns)
    block = Block(READINGS, utc_ns=utc_ns)
    assert not corrected_pose(GEOMETRY, effects_of(ARM, (correction,)), block)[
        2
    ].stale_effect.any()


def test_latency_takes_the_reading_forward_along_its_motion():
    speeds = np.random.default_rng(1).normal(size=READINGS.shape)
    correction = effect("encoder_latency", joint="J3", latency_s=1e-4)
    check(correction, lambda n: -1e-4 * speeds[n, 2], speeds_rad_s=speeds)
    everywhere = effects_of(ARM, (effect("encoder_latency", latency_s=1e-4),))
    corrections_rad = angle_corrections(GEOMETRY, everywhere, Block(READINGS, speeds))
    np.testing.assert_allclose(corrections_rad, -1e-4 * speeds, rtol=1e-14)
    # theta = alpha + latency speed: where the joint is now.
    later = corrected_pose(GEOMETRY, everywhere, Block(READINGS, speeds))[0]
    np.testing.assert_allclose(
        later, probe_pose(GEOMETRY, READINGS + 1e-4 * speeds)[0], atol=1e-10
    )


def test_backlash_has_the_sign_of_the_approach():
    approaches = np.zeros(READINGS.shape)
    approaches[:, 2] = [1, -1, 0, 1, 1, -1, 0]
    correction = effect("backlash", joint="J3", half_width_rad=8e-6)
    check(correction, lambda n: 8e-6 * approaches[n, 2], approaches=approaches)


def test_empirical_spline_of_another_joint_is_the_natural_cubic_one():
    """Against scipy's."""
    knots, values = [-3.0, -1.0, 0.5, 2.0, 3.5], [1e-5, -2e-5, 3e-5, 0.0, 1e-5]
    curve = CubicSpline(knots, values, bc_type="natural")
    correction = effect(
        "empirical", joint="J3", covariate="J5_rad", knots=knots, values_rad=values
    )
    readings = READINGS[:, 4]
    check(correction, lambda n: curve(min(max(readings[n], -3.0), 3.5)))
    flags = corrected_pose(GEOMETRY, effects_of(ARM, (correction,)), Block(READINGS))[2]
    assert flags.empirical.all()
    np.testing.assert_array_equal(
        flags.beyond_knots, (readings < -3.0) | (readings > 3.5)
    )


def test_beyond_its_knots_a_reading_is_as_uncertain_as_a_straight_line_on():
    """The slopes at the outer knots are scipy's."""
    knots, values = (-3.0, -1.0, 0.5, 2.0, 3.5), (1e-4, -2e-4, 3e-4, 0.0, 1e-4)
    correction = effect(
        "empirical", joint="J3", covariate="J5_rad", knots=knots, values_rad=values
    )
    curved, plain = effects_of(ARM, (correction,)), effects_of(ARM, ())
    readings_rad = READINGS[:5].copy()
    readings_rad[:, 4] = (-4.0, -3.0, 0.1, 3.5, 5.5)
    block, n_joints = Block(readings_rad), readings_rad.shape[1]
    noise = PointNoise(np.full(n_joints, 1e-5), np.zeros(n_joints), 0.01, 0.0)
    stated = point_uncertainties(GEOMETRY, curved, block, noise).covariances_mm2
    true_rad = readings_rad - angle_corrections(GEOMETRY, curved, block)
    inside = point_uncertainties(
        GEOMETRY, plain, Block(true_rad), noise
    ).covariances_mm2
    slopes = CubicSpline(knots, values, bc_type="natural")((-3.0, 3.5), 1)
    away_rad = np.array([slopes[0], 0.0, 0.0, 0.0, 2.0 * slopes[1]])
    lever = probe_derivatives(GEOMETRY, true_rad).by_angles[:, :, 2]
    grown = np.einsum("n,ni,nj->nij", away_rad**2, lever, lever)
    assert np.all(np.linalg.norm(grown[[0, 4]], axis=(1, 2)) > 1e-4)
    np.testing.assert_allclose(stated, inside + grown, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize(
    ("covariate", "covariates", "column"),
    [
        ("temperature_c", {"temperature_c": np.arange(7.0)}, np.arange(7.0)),
        ("time_s", {"campaign_s": np.arange(7.0)}, np.arange(7.0)),
        ("force_n", {"force_n": np.arange(7.0)}, np.arange(7.0)),
        ("J2_speed_rad_s", {"speeds_rad_s": 10 + READINGS}, 10 + READINGS[:, 1]),
        ("J2_approach", {"approaches": np.sign(READINGS)}, np.sign(READINGS[:, 1])),
        ("J2_temperature_c", {"temperature_c": np.ones(7)}, np.ones(7)),
        ("J2_rad", {}, READINGS[:, 1]),
    ],
)
def test_empirical_line_of_every_covariate(covariate, covariates, column):
    correction = effect(
        "empirical",
        joint="J3",
        covariate=covariate,
        knots=[-20.0, 20.0],
        values_rad=[-2e-5, 2e-5],
    )
    check(correction, lambda n: 1e-6 * column[n], **covariates)
