"""Tests of blocks against integrals, distributions and actual refits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betaln

from tests.lab.diagnosis.fitted_rows import measured, measured_rows
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import (
    judge,
    log_evidences,
    log_p_values,
    project,
)
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.outcomes.candidate import BankName, Candidate

FACTORS = 10.0 ** np.linspace(-1.5, 1.5, 61)
COSTS = 0.5 * (np.log10(FACTORS) / 0.7) ** 2


def log_p(part, degrees, redundancy):
    parts, sizes = np.array([part], dtype=float), np.array([degrees])
    return float(log_p_values(parts, sizes, redundancy)[0])


def far_log_p(part, degrees, redundancy):
    """log I_x(a, b), x = 1 - part, by Gauss-Laguerre after t = x exp(-w / a)."""
    a, b, x = 0.5 * (redundancy - degrees), 0.5 * degrees, 1.0 - part
    nodes, weights = np.polynomial.laguerre.laggauss(60)
    inner = np.sum(weights * (1.0 - x * np.exp(-nodes / a)) ** (b - 1.0))
    return a * np.log(x) - np.log(a) + np.log(inner) - betaln(a, b)


def bank_of(columns, scale=1.0):
    """One candidate without a meaning."""
    n = columns.shape[1]
    candidate = Candidate(
        bank=BankName.LIBRARY,
        kind="encoder_eccentricity",
        joint="J1",
        order=None,
        component=None,
        covariate=None,
        artefact=None,
        at_s=None,
        parameters=tuple(f"p{index}" for index in range(n)),
        scales=(scale,) * n,
        log_prior=0.0,
    )
    return Bank((candidate,), columns)


@pytest.mark.parametrize("redundancy", [30, 515, 5000])
@pytest.mark.parametrize("degrees", [1, 2, 4, 10])
def test_p_values_are_those_of_f_tests(degrees, redundancy):
    for part in (0.0, 1e-6, 0.003, 0.02, 0.1):
        degrees_left = redundancy - degrees
        f = part / degrees / ((1.0 - part) / degrees_left)
        expected = stats.f.logsf(f, degrees, degrees_left)
        assert log_p(part, degrees, redundancy) == pytest.approx(expected, rel=1e-8)


def test_many_rows_give_the_tail_of_chi_square():
    redundancy, statistic = 10**7, 30.0
    log_chance = log_p(statistic / redundancy, 3, redundancy)
    assert log_chance == pytest.approx(stats.chi2.logsf(statistic, 3), rel=1e-4)


@pytest.mark.parametrize("degrees", [1, 2, 4, 10])
@pytest.mark.parametrize("redundancy", [515, 2000, 15000])
def test_far_tails_do_not_underflow(degrees, redundancy):
    for log_rest in (-0.3, -1.0, -3.0, -8.0):
        part = -np.expm1(log_rest)
        expected = far_log_p(part, degrees, redundancy)
        if expected < -50.0:
            log_chance = log_p(part, degrees, redundancy)
            assert log_chance == pytest.approx(expected, abs=1e-4)


def test_log_p_falls_without_a_jump_where_the_formula_changes():
    redundancy = 5000
    parts = -np.expm1(-np.linspace(0.23, 0.26, 400))
    for degrees in (1, 2, 4, 10):
        log_chances = log_p_values(parts, np.full(400, degrees), redundancy)
        steps = np.diff(log_chances)
        assert log_chances[0] > -600.0 > log_chances[-1]
        assert np.all(steps < 0.0)
        np.testing.assert_allclose(steps, steps.mean(), rtol=0.02)


@given(
    st.floats(0.0, 0.999),
    st.floats(1e-4, 0.9),
    st.integers(1, 12),
    st.integers(40, 3000),
)
def test_more_explained_is_less_likely_by_chance(part, more, degrees, redundancy):
    larger = part + (1.0 - part) * more
    less_likely, before = (
        log_p(explained, degrees, redundancy) for explained in (larger, part)
    )
    assert less_likely <= before <= 0.0
    # Near a probability of 1 the logarithm is lost in rounding.
    assert less_likely < before or before > -1e-6


def test_nothing_visible_says_nothing():
    assert log_p(0.5, 0, 100) == 0.0


def integrated_log_factor(z, s, total, redundancy, factor):
    """The log of likelihoods with the block over without, size and noise integrated."""
    sigmas = np.exp(np.linspace(-0.4, 0.4, 81)) * np.sqrt(total / redundancy)
    units = np.linspace(-8.0, 8.0, 1201)
    # Amplitude in units of factor times sigma; the data see s times that.
    along = s * factor * sigmas[:, np.newaxis] * units
    prior = np.exp(-0.5 * units**2) / np.sqrt(2.0 * np.pi)
    gain = np.exp((z * along - 0.5 * along**2) / sigmas[:, np.newaxis] ** 2)
    without = np.exp(
        -redundancy * np.log(sigmas / sigmas[40])
        - 0.5 * total * (sigmas**-2 - sigmas[40] ** -2)
    )
    given_sigma = np.trapezoid(prior * gain, units, axis=1)
    # d sigma / sigma is even on the grid of logarithms.
    return float(np.log(np.sum(without * given_sigma) / np.sum(without)))


@pytest.mark.parametrize(("z", "s"), [(0.5, 1.0), (3.0, 2.0), (5.0, 0.4), (4.0, 30.0)])
def test_evidence_is_the_integral_over_size_and_noise(z, s):
    redundancy, total = 200, 231.0
    each = [
        integrated_log_factor(z, s, total, redundancy, factor) for factor in FACTORS
    ]
    expected = np.max(np.array(each) - COSTS)
    evidences = log_evidences(np.array([z**2]), np.array([s**2]), total, redundancy)
    assert float(evidences) == pytest.approx(expected, abs=0.02)


def test_with_many_rows_evidence_is_that_of_known_noise():
    # 1/2 sum of k^2 s^2 / (1 + k^2 s^2) z^2 - log(1 + k^2 s^2), two directions.
    z, s = np.array([4.0, -2.5]), np.array([3.0, 0.2])
    grown = FACTORS[:, np.newaxis] ** 2 * s**2
    each = 0.5 * np.sum(grown / (1.0 + grown) * z**2 - np.log1p(grown), axis=1)
    evidences = log_evidences(z**2, s**2, 1e7, 10**7)
    assert float(evidences) == pytest.approx(np.max(each - COSTS), abs=0.02)


def test_evidence_weighs_directions_that_explain_nothing():
    few = log_evidences(np.array([25.0, 0.0]), np.array([9.0, 0.0]), 300.0, 300)
    many = log_evidences(np.array([25.0, 0.0]), np.array([9.0, 9.0]), 300.0, 300)
    assert many < few - 1.0


def test_evidence_does_not_end_where_everything_is_explained():
    evidences = log_evidences(np.array([100.0]), np.array([1e8]), 100.0, 50)
    assert np.isfinite(evidences)


def test_visible_directions_are_orthonormal_and_free_of_the_unknowns():
    rows = measured_rows()
    for projection in project(rows, library_bank(rows, measured().arm)):
        u = projection.directions
        assert u.shape == (len(rows.values), len(projection.singular_values))
        np.testing.assert_allclose(u.T @ u, np.eye(u.shape[1]), atol=1e-6)
        np.testing.assert_allclose(rows.basis.T @ u, 0.0, atol=1e-6)


def test_directions_that_the_unknowns_absorb_are_not_visible():
    rows = measured_rows()
    rng = np.random.default_rng(1)
    absorbed = rows.basis @ rng.normal(size=(rows.basis.shape[1], 2))
    free = rng.normal(size=(len(rows.values), 1))
    (none,) = project(rows, bank_of(100.0 * absorbed))
    assert len(none.singular_values) == 0
    (visible,) = project(rows, bank_of(np.hstack([100.0 * absorbed, free])))
    expected = np.linalg.norm(rows.project(free))
    np.testing.assert_allclose(visible.singular_values, [expected], rtol=1e-6)
    scores = judge(rows, (none, visible))
    assert scores.degrees.tolist() == [0, 1]
    assert scores.log_p[0] == 0.0
    assert scores.statistics[0] == 0.0


def test_a_statistic_is_the_drop_of_the_sum_of_squares():
    rows = measured_rows()
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(len(rows.values), 3))
    both = np.hstack([rows.basis, columns])
    left = rows.values - both @ np.linalg.lstsq(both, rows.values)[0]
    without = rows.values - rows.basis @ np.linalg.lstsq(rows.basis, rows.values)[0]
    drop = without @ without - left @ left
    scores = judge(rows, project(rows, bank_of(columns)))
    assert scores.statistics[0] == pytest.approx(drop, rel=1e-8)
    degrees_left = rows.redundancy - 3
    expected = stats.f.logsf(drop / 3 / (left @ left / degrees_left), 3, degrees_left)
    assert scores.log_p[0] == pytest.approx(expected, rel=1e-7)
    projection = scores.projected[0]
    amplitudes, covariance = projection.amplitudes(rows.residuals)
    fit = np.linalg.lstsq(both, rows.values)[0][-3:]
    np.testing.assert_allclose(amplitudes, fit, rtol=1e-6)
    cofactors = np.linalg.inv(both.T @ both)[-3:, -3:]
    np.testing.assert_allclose(covariance, cofactors, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(
    ("table", "joint"),
    [
        ({"kind": "encoder_eccentricity", "cos_rad": 2e-5, "sin_rad": 1e-5}, "J3"),
        ({"kind": "bearing_compliance", "compliance_rad_nm": 1e-5}, "J2"),
        ({"kind": "thermal_expansion", "expansion_per_c": 5e-6}, None),
        ({"kind": "stylus_bending", "compliance_mm_n": 0.005}, None),
    ],
)
def test_a_statistic_is_what_a_whole_new_fit_gains(table, joint):
    # Iterated, with the effect as a term of the model: no linear algebra in common.
    with_joint = table if joint is None else {**table, "joint": joint}
    effect = effect_from_table(with_joint)
    given_here = measured().with_effect(effect)
    without = given_here.fit()
    sizes = {key: 0.0 for key in table if key != "kind"}
    with_it = given_here.fit((effect_from_table({**with_joint, **sizes}),))
    assert np.array_equal(without.included, with_it.included)
    drop = (
        without.adjustment.system.sum_of_squares
        - with_it.adjustment.system.sum_of_squares
    )
    rows = given_here.rows()
    scores = judge(rows, project(rows, library_bank(rows, given_here.arm)))
    (at,) = [
        at
        for at, candidate in enumerate(scores.candidates)
        if (candidate.kind, candidate.joint) == (table["kind"], joint)
    ]
    assert drop > 20.0
    assert scores.statistics[at] == pytest.approx(drop, rel=0.01)


def test_a_wrong_noise_level_changes_no_test():
    rows = measured_rows()
    louder = replace(rows, values=1.4 * rows.values)
    projected = project(rows, library_bank(rows, measured().arm))
    quiet, loud = judge(rows, projected), judge(louder, projected)
    np.testing.assert_allclose(loud.log_p, quiet.log_p, rtol=1e-9)
    np.testing.assert_allclose(loud.evidences, quiet.evidences, rtol=1e-9)


def test_an_empty_bank_has_no_findings():
    rows = measured_rows()
    assert project(rows, Bank((), np.empty((len(rows.values), 0)))) == ()
    assert judge(rows, ()).log_p.shape == (0,)
