"""False alarms as often as said; serial noise recognised, estimated, taken out."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import linalg, stats

from tests.lab.diagnosis.fitted_rows import measured, measured_rows
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import project
from traverse.lab.diagnosis.candidates.steps import scan_steps
from traverse.lab.diagnosis.model.serial_noise import (
    SerialCorrelation,
    is_serially_correlated,
    likeliest_serial_noise,
    serial_correlation,
    serial_evidence,
    without_serial_noise,
)
from traverse.lab.diagnosis.search.thresholds import log_p_threshold, noise_draws


def correlated_errors(rows, share, phi, n_draws, seed):
    """Errors of rows whose readings and contacts wander, pose after pose in time."""
    rng = np.random.default_rng(seed)
    times_s = rows.adjustment.network.campaign.poses.time_s
    n_sources = rows.sources.shape[1]
    wander = rng.normal(size=(len(times_s), n_sources, n_draws))
    order = np.argsort(times_s)
    for before, now in pairwise(order):
        wander[now] = phi * wander[before] + np.sqrt(1.0 - phi**2) * wander[now]
    white = rng.normal(size=wander.shape)
    both = np.sqrt(share) * wander + np.sqrt(1.0 - share) * white
    errors = np.einsum("rs,rsd->rd", rows.sources, both[rows.poses])
    certificates = rows.poses < 0
    errors[certificates] = rng.normal(size=(np.count_nonzero(certificates), n_draws))
    return errors


def test_draws_are_of_unit_weight_and_free_of_the_unknowns():
    rows = measured_rows()
    draws = noise_draws(rows, 2000, 5)
    np.testing.assert_allclose(rows.basis.T @ draws, 0.0, atol=1e-9)
    squares = np.sum(draws**2, axis=0)
    std = np.sqrt(2.0 / rows.redundancy / 2000)
    assert squares.mean() / rows.redundancy == pytest.approx(1.0, abs=4.0 * std)
    assert np.array_equal(draws[:, :5], noise_draws(rows, 2000, 5)[:, :5])


def test_fresh_noise_alarms_as_often_as_said():
    rows = measured_rows()
    bank = project(rows, library_bank(rows, measured().arm))
    draws = noise_draws(rows, 2000, 1)
    n_fresh = 4000
    fresh = noise_draws(rows, n_fresh, 2)
    totals = np.sum(fresh**2, axis=0)
    lowest = np.zeros(n_fresh)
    for candidate in bank:
        q = len(candidate.singular_values)
        if q == 0:
            continue
        explained = np.sum((candidate.directions.T @ fresh) ** 2, axis=0)
        degrees_left = rows.redundancy - q
        f = explained / q / ((totals - explained) / degrees_left)
        lowest = np.minimum(lowest, stats.f.logsf(f, q, degrees_left))
    for level in (0.01, 0.05):
        rate = np.mean(lowest < log_p_threshold(rows, bank, draws, level))
        assert 0.5 * level < rate < 1.8 * level


def test_scans_lower_a_threshold():
    rows = measured_rows()
    draws = noise_draws(rows, 400, 1)
    scans = tuple(scan.largest for scan in scan_steps(rows))
    of_first = log_p_threshold(rows, (), draws, 0.01, scans[:1])
    all_of_them = log_p_threshold(rows, (), draws, 0.01, scans)
    assert all_of_them < of_first < np.log(0.01)
    # Never beyond what as many tests as moments and steps could need.
    n_tests = len(scans) * len(measured().campaign.poses)
    assert all_of_them > np.log(0.01 / n_tests) - 1.0


def test_a_threshold_goes_with_the_logarithm_of_the_level():
    rows = measured_rows()
    bank = project(rows, library_bank(rows, measured().arm))[:5]
    draws = noise_draws(rows, 500, 1)
    strict, loose = (log_p_threshold(rows, bank, draws, x) for x in (1e-4, 1e-2))
    assert loose - strict == pytest.approx(np.log(100.0))


@pytest.mark.parametrize(("share", "phi"), [(0.4, 0.95), (0.5, 0.8)])
def test_serial_noise_is_recognised_and_estimated(share, phi):
    rows = measured_rows()
    errors = correlated_errors(rows, share, phi, 12, seed=4)
    white = noise_draws(rows, 300, 6)
    drawn = [replace(rows, values=error) for error in errors.T]
    assert sum(is_serially_correlated(draw, white, 0.01) for draw in drawn) >= 11
    estimates = [serial_correlation(draw) for draw in drawn]
    # The unknowns take a part of what is slow.
    shares = [estimate.share for estimate in estimates]
    assert 0.6 * share < np.mean(shares) < 1.2 * share
    phis = [estimate.phi for estimate in estimates]
    assert np.mean(phis) == pytest.approx(phi, abs=0.08)


def test_evidence_of_serial_noise_is_that_of_restricted_likelihoods():
    rows = measured_rows()
    noise = SerialCorrelation(0.4, 0.9)
    errors = correlated_errors(rows, noise.share, noise.phi, 1, seed=3)[:, 0]
    rows = replace(rows, values=errors)
    root = without_serial_noise(rows, noise).root
    contrasts = linalg.null_space(rows.basis.T)  # free of the unknowns
    serial, white = contrasts.T @ root @ root.T @ contrasts, np.eye(contrasts.shape[1])
    seen, n = contrasts.T @ errors, contrasts.shape[1]
    logs = [
        -0.5 * np.linalg.slogdet(matrix)[1]
        - 0.5 * n * np.log(seen @ np.linalg.solve(matrix, seen))
        for matrix in (serial, white)
    ]
    evidence = serial_evidence(rows, noise)
    assert evidence == pytest.approx(logs[0] - logs[1], rel=1e-6)
    assert evidence > 10.0
    likeliest, largest = likeliest_serial_noise(rows)
    assert largest >= evidence - 2.0
    assert abs(likeliest.phi - noise.phi) <= 0.1
    fresh = np.random.default_rng(5).normal(size=len(errors))
    assert serial_evidence(replace(rows, values=fresh), noise) < 0.0


def test_white_noise_is_not_called_serial():
    rows = measured_rows()
    white = noise_draws(rows, 500, 6)
    errors = np.random.default_rng(8).normal(size=(30, len(rows.values)))
    fresh = [replace(rows, values=error) for error in errors]
    alarms = sum(is_serially_correlated(draw, white, 0.02) for draw in fresh)
    assert alarms <= stats.binom.isf(1e-4, 30, 0.02)
    shares = [serial_correlation(draw).share for draw in fresh]
    assert np.median(shares) < 0.1


def test_rows_without_serial_noise_are_white():
    rows = measured_rows()
    share, phi, n_draws = 0.5, 0.9, 1500
    decorrelated = without_serial_noise(rows, SerialCorrelation(share, phi))
    errors = correlated_errors(rows, share, phi, n_draws, seed=9)
    of_white = decorrelated.decorrelated(errors)
    for whitened, is_white in ((of_white, True), (errors, False)):
        covariance = whitened @ whitened.T / n_draws
        np.testing.assert_allclose(np.diag(covariance), 1.0, atol=6 / n_draws**0.5)
        apart = covariance - np.diag(np.diag(covariance))
        assert (np.abs(apart).max() < 6.0 / np.sqrt(n_draws)) == is_white


def test_unknowns_are_taken_out_of_decorrelated_rows_too():
    rows = measured_rows()
    white = without_serial_noise(rows, SerialCorrelation(0.3, 0.95))
    np.testing.assert_allclose(white.root @ white.values, rows.values, atol=1e-9)
    left = white.project(white.columns)
    assert np.abs(left).max() < 0.02
    assert white.redundancy == rows.redundancy


def test_no_share_leaves_the_rows_as_they_are():
    rows = measured_rows()
    same = without_serial_noise(rows, SerialCorrelation(0.0, 0.9))
    np.testing.assert_allclose(same.values, rows.values, atol=1e-12)
