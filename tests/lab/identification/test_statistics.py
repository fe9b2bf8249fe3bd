"""Statistics of an adjustment against dense textbook formulas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tests.lab.simulated import DESIGN, DESIGN_ARM, bar, built, cones, simulate
from traverse.lab.adjustment.equations import whiteners
from traverse.lab.adjustment.system import (
    decide_rank,
    eliminate_unknowns,
    sequential_qr,
)
from traverse.lab.identification.identify import Options, identify
from traverse.lab.statistics.distributions import (
    chi_square_log_tail,
    equivalent_normal,
    excess_p_value,
    tau_critical,
)

OPTIONS = Options(snooping=False, coarse_start=False)


@pytest.fixture(scope="module")
def result():
    tables = [*cones(2), bar(distance_std_mm=0.003), {"id": "p", "kind": "plane"}]
    campaign = simulate(built(1), tables, 30, 5)
    return identify(campaign, DESIGN_ARM, OPTIONS)


@pytest.fixture(scope="module")
def dense(result):
    """The whole whitened system as one matrix: unknowns of stations, parameters."""
    adjustment = result.adjustment
    network, state = adjustment.network, adjustment.state
    widths = [len(station.scales) for station in network.stations]
    n_unknowns = sum(widths)
    n_all = n_unknowns + network.parameters.n_free
    rows, right, poses = [], [], []
    at = 0
    for index, station in enumerate(network.stations):
        unknowns, columns = state.unknowns[index], slice(at, at + widths[index])
        certificate = station.artefact.certificate(unknowns, station.touches)
        for value in range(len(certificate.std_mm)):
            row = np.zeros(n_all)
            row[columns] = certificate.by_unknowns[value] / certificate.std_mm[value]
            rows.append(row)
            right.append(certificate.misclosures_mm[value] / certificate.std_mm[value])
            poses.append(-1)
        corrections = state.corrections[index]
        for part in network.white_rows(station, state.arm, unknowns, corrections):
            for pose in range(len(part.misclosures)):
                for equation in range(part.misclosures.shape[1]):
                    row = np.zeros(n_all)
                    row[columns] = part.by_unknowns[pose, equation]
                    row[n_unknowns:] = part.by_parameters[pose, equation]
                    rows.append(row)
                    right.append(part.misclosures[pose, equation])
                    poses.append(station.poses[part.part][pose])
        at += widths[index]
    return np.array(rows), np.array(right), np.array(poses), n_unknowns


def test_the_covariance_is_the_inverse_normal_matrix(result, dense):
    matrix, _, _, n_unknowns = dense
    inverse = np.linalg.inv(matrix.T @ matrix)[n_unknowns:, n_unknowns:]
    cofactors = result.covariance / result.variance_factor
    scale = np.sqrt(np.outer(np.diag(inverse), np.diag(inverse)))
    assert np.allclose(cofactors / scale, inverse / scale, rtol=0, atol=1e-5)


def test_the_condition_number_is_that_of_the_arms_columns_scaled_to_one(result, dense):
    matrix, _, _, n_unknowns = dense
    unknowns, columns = matrix[:, :n_unknowns], matrix[:, n_unknowns:]
    left = columns - unknowns @ np.linalg.lstsq(unknowns, columns)[0]
    expected = np.linalg.cond(left / np.linalg.norm(left, axis=0))
    assert result.condition_number == pytest.approx(expected, rel=1e-6)


def test_the_estimates_are_stationary(dense):
    matrix, right, *_ = dense
    sizes = np.linalg.norm(matrix, axis=0)
    assert np.max(np.abs(matrix.T @ right) / sizes) < 1e-4


def test_redundancy_numbers_add_up_to_the_redundancy(result, dense):
    matrix, right, poses, _ = dense
    projector = np.eye(len(matrix)) - matrix @ np.linalg.pinv(matrix)
    assert np.trace(projector) == pytest.approx(result.redundancy)
    for pose in range(len(result.included)):
        mine = np.flatnonzero(poses == pose)
        block = projector[np.ix_(mine, mine)]
        expected = np.trace(block) / len(mine)
        assert result.statistics.controllability[pose] == pytest.approx(
            expected, abs=1e-5
        )
        statistic = right[mine] @ np.linalg.solve(block, right[mine])
        assert result.statistics.statistics[pose] == pytest.approx(statistic, rel=1e-3)


def test_redundancies_of_the_sources_of_noise_add_up(result):
    sums = result.statistics.variances
    certified = 3
    total = sums.redundancies.sum()
    # Certificates have the rest: between none and all of theirs.
    assert result.redundancy - certified <= total <= result.redundancy + 1e-6


def test_sigma0_is_the_weighted_sum_over_the_redundancy(result, dense):
    _, right, *_ = dense
    expected = np.sqrt(right @ right / result.redundancy)
    assert result.sigma0 == pytest.approx(expected, rel=1e-9)


def test_controllability_is_one_without_competition(result):
    normal = np.linalg.inv(result.covariance / result.variance_factor)
    for index, entry in enumerate(result.parameters):
        product = (
            normal[index, index]
            * result.covariance[index, index]
            / result.variance_factor
        )
        assert entry.controllability == pytest.approx(1.0 / product, rel=1e-3)


def test_w_is_standard_normal_in_a_clean_campaign():
    tables = [{"id": f"s{i}", "kind": "sphere", "radius_mm": 25.0} for i in range(4)]
    campaign = simulate(built(1), tables, 100, 6)
    result = identify(campaign, DESIGN_ARM, OPTIONS)
    w = result.statistics.w
    assert np.mean(w**2) == pytest.approx(1.0, abs=0.2)
    assert np.mean(w > 1.96) == pytest.approx(0.05, abs=0.03)


def test_an_error_of_the_detectable_size_is_about_as_large_as_said(result):
    # 0.005 mm of contact and some readings' noise: 4.13 of that at least.
    detectable = result.statistics.detectable_mm
    assert np.all(detectable > 0.02)
    assert np.median(detectable) < 0.06


def test_suggested_poses_stay_within_the_travel_that_was_shown():
    travel_rad = np.radians([150, 75, 150, 75, 150, 60, 4.0])
    turns = np.random.default_rng(2).uniform(-0.4, 0.4, (3, 7))
    middles_mm = DESIGN.centres(DESIGN.zeros_rad + turns * travel_rad)
    tables = [
        {**table, "place_mm": middle_mm}
        for table, middle_mm in zip(cones(3), middles_mm, strict=True)
    ]
    campaign = simulate(built(1), tables, 40, 5, travel_rad=travel_rad)
    result = identify(campaign, DESIGN_ARM, OPTIONS)
    angles_rad = np.array([entry.angles_rad for entry in result.suggestions])
    assert len(angles_rad) == 8
    shown_rad = campaign.poses.angles_rad
    # The last joint hardly turned: more travel is requested of it alone.
    below = shown_rad.min(axis=0) - angles_rad.min(axis=0)
    above = angles_rad.max(axis=0) - shown_rad.max(axis=0)
    assert max(below[:6].max(), above[:6].max()) <= 0.0
    assert 0.0 < max(below[6], above[6]) <= np.radians(30.0)


def test_suggested_poses_touch_and_help(result):
    assert len(result.suggestions) == 8
    left = [entry.variance_left for entry in result.suggestions]
    assert left == sorted(left, reverse=True)
    assert left[0] < 1.0
    # Measured, a suggestion lowers the variance as promised.
    best = result.suggestions[0]
    ids = [artefact.id for artefact in result.campaign.artefacts]
    index = ids.index(best.artefact)
    feature = result.campaign.feature_names[index].index(best.feature)
    poses = result.campaign.poses
    more = replace(
        poses,
        lines=np.append(poses.lines, 999),
        time_s=np.append(poses.time_s, 999.0),
        artefacts=np.append(poses.artefacts, index),
        features=np.append(poses.features, feature),
        angles_rad=np.vstack([poses.angles_rad, best.angles_rad]),
    )
    again = identify(
        replace(result.campaign, poses=more),
        DESIGN_ARM,
        replace(OPTIONS, n_suggestions=0),
    )
    assert np.all(np.diag(again.covariance) <= np.diag(result.covariance) * 1.001)
    assert again.adjustment.sigma0 == pytest.approx(result.sigma0, rel=0.02)


@settings(max_examples=30)
@given(st.integers(1, 3000), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_a_triangle_stands_for_all_rows(n_rows, n_columns, seed):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(n_rows, n_columns))
    cuts = sorted(rng.integers(0, n_rows, 5))
    upper = sequential_qr(np.split(rows, cuts), n_columns)
    assert len(upper) <= max(n_columns, 1)
    assert np.allclose(upper.T @ upper, rows.T @ rows, atol=1e-9 * max(n_rows, 1))


def test_elimination_solves_like_the_whole_system():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(40, 3 + 5 + 1)) * 10
    eliminated = eliminate_unknowns(sequential_qr([rows], 9), np.full(3, 100.0))
    arm = np.linalg.lstsq(eliminated.reduced[:, :5], eliminated.reduced[:, 5])[0]
    solution = np.linalg.lstsq(rows[:, :8], rows[:, 8])[0]
    assert arm == pytest.approx(solution[3:])
    assert eliminated.step(arm) == pytest.approx(solution[:3])


def test_unknowns_that_nothing_determines_are_held():
    rows = np.zeros((4, 2 + 1 + 1))
    rows[:, 0], rows[:, 2], rows[:, 3] = [1, 2, 3, 4], [1, 0, 1, 0], [1, 1, 1, 1]
    eliminated = eliminate_unknowns(sequential_qr([rows], 4), np.array([10.0, 10.0]))
    assert len(eliminated.right) == 1
    assert np.abs(eliminated.held[0]) == pytest.approx([0.0, 1.0])
    assert eliminated.step(np.zeros(1))[1] == 0.0


def test_rank_is_decided_in_units_of_the_tolerances():
    upper = np.array([[2.0, 0, 4.0], [0, 0.004, 0.1]])
    # The second deviates by 1 / 0.004 = 250: worse than 100, better than 1000.
    for tolerance, determined in ((100.0, 1), (1000.0, 2)):
        parts = decide_rank(upper, np.array([1.0, tolerance]), np.empty((0, 2)))
        assert parts.n_determined == determined
        step, _ = parts.step(np.array([0.0, 7.0]))
        assert step == pytest.approx([2.0, 7.0 if determined == 1 else 25.0])


@settings(max_examples=30)
@given(st.sampled_from([1, 3]), st.integers(0, 2**32 - 1))
def test_whitening_makes_unit_dispersions(n_rows, seed):
    rng = np.random.default_rng(seed)
    by_readings = rng.normal(size=(20, n_rows, 7))
    by_contact = rng.normal(size=(20, n_rows, 3))
    factors = whiteners(by_readings, by_contact)
    noise = np.concatenate([by_readings, by_contact], axis=2)
    white = factors @ noise
    assert np.allclose(white @ white.swapaxes(1, 2), np.eye(n_rows), atol=1e-8)


def test_tails_agree_with_the_tables():
    assert equivalent_normal(np.array([9.0]), np.array([1.0])) == pytest.approx(3.0)
    # P(chi^2 with 3 degrees > 16.266) = 0.001, and so is P(|z| > 3.2905).
    three = equivalent_normal(np.array([16.266]), np.array([3.0]))
    assert three == pytest.approx(3.2905, abs=1e-3)
    log_tail = chi_square_log_tail(np.array([50.0, 1400.0]), np.array([3.0, 3.0]))
    assert log_tail == pytest.approx(stats.chi2.logsf([50.0, 1400.0], 3), rel=1e-3)
    assert np.isfinite(equivalent_normal(np.array([1e6]), np.array([3.0]))).all()
    assert equivalent_normal(np.array([0.0]), np.array([0.0])) == 0.0
    # Pope's tau: Student's t of 9 degrees at 0.975 is 2.262.
    expected = 2.2622 * np.sqrt(10) / np.sqrt(9 + 2.2622**2)
    assert tau_critical(0.05, 10) == pytest.approx(expected, rel=1e-4)


@given(*[st.integers(0, 40)] * 4)
def test_more_here_than_there_is_as_unlikely_as_fisher_says(a, b, c, d):
    expected = stats.fisher_exact([[a, b], [c, d]], alternative="greater")[1]
    p_value = excess_p_value(a, a + b, c, c + d)
    assert p_value == pytest.approx(expected, rel=1e-9)
