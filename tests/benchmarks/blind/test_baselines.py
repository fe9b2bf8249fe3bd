import numpy as np
import pytest

from benchmarks.blind.baselines import (
    BASELINES,
    forward_bic,
    overall_test,
    raw_correlation,
    sparse_regression,
)
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName, Candidate

N_ROWS = 300


def candidate(joint, size):
    return Candidate(
        bank=BankName.LIBRARY,
        kind="encoder_scale",
        joint=joint,
        order=None,
        component=None,
        covariate=None,
        artefact=None,
        at_s=None,
        parameters=tuple(f"p{number}" for number in range(size)),
        scales=(1.0,) * size,
        log_prior=0.0,
    )


@pytest.fixture
def problem():
    """Rows of two unknowns and three candidates; the second is hidden below."""
    rng = np.random.default_rng(5)
    basis = np.linalg.qr(rng.standard_normal((N_ROWS, 2)))[0]
    columns = rng.standard_normal((N_ROWS, 4))
    # What the first one does is mostly absorbed by the unknowns.
    columns[:, 0] = 30.0 * basis[:, 0] + 0.01 * columns[:, 0]
    bank = Bank((candidate("J1", 1), candidate("J2", 1), candidate("J3", 2)), columns)
    return basis, bank, rng


def rows(basis, values):
    return ObservationEquations(
        adjustment=None,
        poses=np.arange(N_ROWS),
        values=values,
        by_centre=np.zeros((N_ROWS, 3)),
        by_turn=np.zeros((N_ROWS, 3)),
        sources=np.zeros((N_ROWS, 3)),
        columns=basis,
        basis=basis,
        certificates=(),
    )


@pytest.mark.parametrize("rival", BASELINES.values(), ids=list(BASELINES))
def test_a_large_effect_is_detected(rival, problem):
    basis, bank, rng = problem
    values = rng.standard_normal(N_ROWS) + 2.0 * bank.columns[:, 1]
    assert rival(rows(basis, values), bank).detected


@pytest.mark.parametrize("rival", [raw_correlation, forward_bic, sparse_regression])
def test_the_right_one_is_named(rival, problem):
    basis, bank, rng = problem
    values = rng.standard_normal(N_ROWS) + 2.0 * bank.columns[:, 1]
    assert rival(rows(basis, values), bank).names[0][1] == "J2"


def test_the_overall_test_names_nothing(problem):
    basis, bank, rng = problem
    values = 3.0 * rng.standard_normal(N_ROWS)
    assert overall_test(rows(basis, values), bank).names == ()


def test_the_overall_test_takes_the_noise_as_stated(problem):
    basis, bank, _ = problem
    # As many squares as there are degrees of freedom: just as expected.
    values = np.ones(N_ROWS)
    values -= basis @ (basis.T @ values)
    values *= np.sqrt((N_ROWS - 2) / np.sum(values**2))
    assert not overall_test(rows(basis, values), bank).detected
    assert overall_test(rows(basis, 1.4 * values), bank).detected


def test_lasso_finds_nothing_in_residuals_across_all_columns(problem):
    basis, bank, rng = problem
    everything = np.column_stack([basis, bank.columns])
    q = np.linalg.qr(everything)[0]
    noise = rng.standard_normal(N_ROWS)
    noise -= q @ (q.T @ noise)
    assert not sparse_regression(rows(basis, noise), bank).detected
    assert not forward_bic(rows(basis, noise), bank).detected


def test_bic_adds_two_where_two_are(problem):
    basis, bank, rng = problem
    values = rng.standard_normal(N_ROWS)
    values += 2.0 * bank.columns[:, 1] + 3.0 * bank.columns[:, 2]
    names = forward_bic(rows(basis, values), bank).names
    assert {name[1] for name in names[:2]} == {"J2", "J3"}
