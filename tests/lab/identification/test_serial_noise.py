"""Streams: samples that share noise say less than as many single poses."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from tests.lab.simulated import DESIGN_ARM, Noise, bar, built, cones, simulate
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import WORDS, result_map, summary_lines
from traverse.lab.identification.results.files import identification_json
from traverse.lab.identification.stream_noise import correlations

PHI = 0.6
ENCODER_RAD = 5e-6
STEP_S = 0.005
N_HELD = 48  # samples in each posture, then nothing is touched
OPTIONS = Options(coarse_start=False, n_suggestions=0)


@cache
def postures(std_mm):
    stds = dict.fromkeys(("distance_std_mm", "radius_std_mm"), std_mm)
    tables = [*cones(3), bar(**stds)]
    silence = Noise(encoder_rad=0.0, contact_mm=0.0)
    return simulate(built(1), tables, 30, 5, noise=silence)


def stream(phi, seed=3, std_mm=1e-5, is_stream=True):
    """Postures held for some samples each, with first-order autoregressive noise."""
    held = postures(std_mm)
    rows = np.repeat(np.arange(len(held.poses)), N_HELD)
    poses = held.poses.part(rows)
    shape = (200 + N_HELD, len(held.poses), 7)
    fresh = np.random.default_rng(seed).normal(size=shape)
    noise = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], fresh, axis=0)[200:]
    noise = noise.swapaxes(0, 1).reshape(-1, 7)
    numbers = np.arange(len(rows)) + rows
    return replace(
        held,
        poses=replace(
            poses,
            lines=numbers + 1,
            time_s=STEP_S * numbers,
            angles_rad=poses.angles_rad + ENCODER_RAD * noise,
        ),
        encoder_rad=ENCODER_RAD,
        contact_mm=1e-5,
        is_stream=is_stream,
    )


def identified(**more):
    return identify(stream(**more), DESIGN_ARM, OPTIONS)


@pytest.fixture(scope="module")
def shared():
    return identified(phi=PHI)


@pytest.fixture(scope="module")
def single():
    """The same, taken as independent poses."""
    return identified(phi=PHI, is_stream=False)


def test_how_many_samples_say_as_much_as_one_is_that_of_the_process(shared):
    # The sums of phi^l and phi^2l: (1 + phi) / (1 - phi), (1 + phi^2) / (1 - phi^2).
    serial = shared.serial_noise
    assert serial.samples_per_mean == pytest.approx(4.0, rel=0.15)
    assert serial.samples_per_square == pytest.approx(1.36 / 0.64, rel=0.1)
    # 0.6^5 = 0.078, 0.6^6 = 0.047.
    assert serial.lasts_s == pytest.approx(6 * STEP_S, abs=1.5 * STEP_S)


def test_correlations_are_those_of_the_process(shared):
    estimates = correlations(shared.adjustment)[:20]
    assert np.allclose(estimates, PHI ** np.arange(1, 21), atol=0.06)


def test_samples_that_share_nothing_count_as_they_are():
    serial = identified(phi=0.0).serial_noise
    assert serial.samples_per_mean == pytest.approx(1.0, abs=0.15)
    assert serial.samples_per_square == pytest.approx(1.0, abs=0.02)
    assert serial.lasts_s == pytest.approx(STEP_S)


def test_samples_that_were_excluded_change_no_correlation():
    campaign = stream(phi=PHI)
    spoilt = np.random.default_rng(1).choice(len(campaign.poses), 60, replace=False)
    campaign.poses.angles_rad[spoilt, 3] += 1e-3
    result = identify(campaign, DESIGN_ARM, OPTIONS)
    assert set(np.flatnonzero(~result.included)) >= set(spoilt)
    assert np.count_nonzero(~result.included) < 70
    of_process = PHI ** np.arange(1, 21)
    assert np.allclose(correlations(result.adjustment)[:20], of_process, atol=0.06)


def test_standard_deviations_grow_with_the_noise_that_is_shared(shared, single):
    tau = shared.serial_noise.samples_per_mean
    stds = [np.sqrt(np.diag(result.covariance)) for result in (shared, single)]
    assert stds[0] / stds[1] == pytest.approx(np.sqrt(tau), rel=1e-3)
    ours, theirs = (
        result.adjustment.state.arm.geometry.links_mm for result in (shared, single)
    )
    assert np.allclose(ours, theirs, atol=1e-4)


def test_estimates_are_as_far_off_as_the_covariance_says(shared, single):
    """Distances between the held postures themselves, whitened."""
    truth = built(1)
    angles_rad = postures(1e-5).poses.angles_rad
    pairs = np.random.default_rng(2).permutation(len(angles_rad))[:80]

    def lengths(centres_mm):
        return np.linalg.norm(centres_mm[:40] - centres_mm[40:], axis=1)

    def square(result):
        parameters = result.adjustment.network.parameters
        at = result.adjustment.state.arm
        steps = np.diag(1e-4 * parameters.free_tolerances)

        def of(values):
            return lengths(probe_centre(values.geometry, angles_rad[pairs]))

        slopes = np.stack(
            [
                (of(parameters.moved(at, s)) - of(parameters.moved(at, -s)))
                / (2.0 * s.sum())
                for s in steps
            ],
            axis=1,
        )
        errors_mm = of(at) - lengths(truth.centres(angles_rad[pairs]))
        left, sizes, _ = np.linalg.svd(slopes @ result.adjustment.split.inverse)
        seen = sizes > 1e-7 * sizes[0]
        white = (left.T @ errors_mm)[: len(sizes)][seen] / sizes[seen]
        return float(white @ white), int(np.count_nonzero(seen))

    distance, degrees = square(shared)
    assert chi2.ppf(0.001, degrees) < distance < chi2.ppf(0.999, degrees)
    assert square(single)[0] > chi2.ppf(0.999, degrees)


def test_a_standard_stays_as_uncertain_as_it_was():
    """Where its length is all that is unsure, samples and their noise do not matter."""
    results = [
        identified(phi=PHI, std_mm=0.02, is_stream=is_stream)
        for is_stream in (True, False)
    ]
    largest = [
        np.linalg.eigvalsh(
            result.covariance / np.outer(*[_tolerances(result)] * 2)
        ).max()
        for result in results
    ]
    assert largest[0] == pytest.approx(largest[1], rel=1e-3)


def _tolerances(result):
    return result.adjustment.network.parameters.free_tolerances


def test_the_test_of_sigma0_counts_samples_by_what_they_say(shared, single):
    serial = shared.serial_noise
    weight = 1.0 / serial.samples_per_mean
    assert np.all(shared.adjustment.network.weights == weight)
    # The same residuals, but each unknown took more of them.
    alone = single.adjustment
    n_unknowns = alone.network.n_rows - single.redundancy
    n_estimated = alone.network.n_rows - shared.redundancy
    assert n_estimated == pytest.approx(serial.samples_per_mean * n_unknowns, abs=1)
    total = alone.system.sum_of_squares
    assert shared.sigma0**2 * shared.redundancy == pytest.approx(total)
    theta = serial.samples_per_square
    upper = chi2.sf(total / theta, shared.redundancy / theta)
    expected = 2.0 * min(upper, 1.0 - upper)
    assert shared.global_test.p_value == pytest.approx(expected)


def test_it_is_reported_on_the_terminal_and_in_the_file(shared, single):
    sentence = "Neighbouring samples of the stream share noise"
    assert sentence in WORDS.serial(shared)
    uncertainty = result_map(shared)
    assert WORDS.serial(shared) in summary_lines(shared, uncertainty)
    values = identification_json(shared)["serial_noise"]
    assert set(values) == {"lasts_s", "samples_per_mean", "samples_per_square"}
    assert WORDS.serial(single) == ""
    assert not any(sentence in line for line in summary_lines(single, uncertainty))
    assert identification_json(single)["serial_noise"] is None
