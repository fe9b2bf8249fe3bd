"""Rivals of the diagnosis on the same equations.

Four usual ways, each at its best on the rows of a fit: the overall test, the
correlation of raw residuals with regressors, forward selection by BIC, and sparse
regression. All use the rows without contradicting poses.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.stats import (
    chi2,
    f,
)

from traverse.arrays import Floats
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

Identity = tuple[str, str | None, int | None, str | None, str | None]

_LEVEL = 0.01
_MOST_TERMS = 4
_SWEEPS = 60
# Of a column's squared length: less is left of it only by rounding.
_INVISIBLE = 1e-9
# Least singular value, in standard deviations at the plausible size, that counts.
_LEAST = 0.016


@dataclass(frozen=True, slots=True)
class BaselineResult:
    """Answer of a rival.

    Attributes:
        names: the strongest first; a rival that only detects has none.
    """

    detected: bool
    names: tuple[Identity, ...]


def overall_test(rows: ObservationEquations, _bank: Bank) -> BaselineResult:
    """Test the sum of squares against its expectation under the stated noise."""
    tail = float(chi2.sf(rows.sum_of_squares, rows.redundancy))
    return BaselineResult(tail < _LEVEL, ())


def raw_correlation(rows: ObservationEquations, bank: Bank) -> BaselineResult:
    """Correlate the residuals with columns without projecting unknowns out."""
    residuals = rows.residuals
    total = float(residuals @ residuals)
    n_rows = len(residuals)
    best, least, name = 0.0, 1.0, None
    for candidate, columns in zip(bank.candidates, bank.slices, strict=True):
        explained = _explained(bank.columns[:, columns], residuals)
        degrees = candidate.size
        ratio = explained / degrees / ((total - explained) / (n_rows - degrees))
        least = min(least, float(f.sf(ratio, degrees, n_rows - degrees)))
        if explained / total > best:
            best, name = explained / total, candidate.identity
    detected = least < _LEVEL / max(len(bank.candidates), 1)
    return BaselineResult(detected, (name,) if detected and name is not None else ())


def forward_bic(rows: ObservationEquations, bank: Bank) -> BaselineResult:
    """Add the candidate that lowers BIC most, while one does."""
    columns = rows.project(bank.columns)
    residuals = rows.residuals
    n = rows.redundancy
    names: list[Identity] = []
    while len(names) < _MOST_TERMS:
        total = float(residuals @ residuals)
        best, chosen = 0.0, None
        for number, part in enumerate(bank.slices):
            basis = _spanned(columns[:, part])
            explained = float(np.sum((basis.T @ residuals) ** 2))
            gain = -n * np.log1p(-explained / total) - basis.shape[1] * np.log(n)
            if gain > best:
                best, chosen = gain, (number, basis)
        if chosen is None:
            break
        number, basis = chosen
        names.append(bank.candidates[number].identity)
        columns = columns - basis @ (basis.T @ columns)
        residuals = residuals - basis @ (basis.T @ residuals)
    return BaselineResult(bool(names), tuple(names))


def sparse_regression(rows: ObservationEquations, bank: Bank) -> BaselineResult:
    """Lasso by coordinate descent on all columns of unit length together.

    The penalty is sqrt(2 log p) standard deviations of the noise, p columns: noise
    alone then selects hardly any column.
    """
    columns = rows.project(bank.columns)
    lengths = np.linalg.norm(columns, axis=0)
    is_visible = lengths > _LEAST
    unit = columns[:, is_visible] / lengths[is_visible]
    n_columns = unit.shape[1]
    sigma = np.sqrt(rows.sum_of_squares / rows.redundancy)
    penalty = sigma * np.sqrt(2.0 * np.log(max(n_columns, 2)))
    products = unit.T @ unit
    gradient = unit.T @ rows.residuals
    amplitudes = np.zeros(n_columns)
    for _ in range(_SWEEPS):
        largest = 0.0
        for column in range(n_columns):
            unpenalised = gradient[column] + amplitudes[column]
            new = float(np.sign(unpenalised) * max(abs(unpenalised) - penalty, 0.0))
            step = new - amplitudes[column]
            if step:
                gradient -= products[:, column] * step
                amplitudes[column] = new
                largest = max(largest, abs(step))
        if largest < 1e-3 * sigma:
            break
    full_amplitudes = np.zeros(len(lengths))
    full_amplitudes[is_visible] = amplitudes
    sizes = np.array([np.linalg.norm(full_amplitudes[part]) for part in bank.slices])
    order = [int(column) for column in np.argsort(-sizes) if sizes[column] > 0.0]
    return BaselineResult(
        bool(order), tuple(bank.candidates[column].identity for column in order)
    )


BASELINES: Mapping[str, Callable[[ObservationEquations, Bank], BaselineResult]] = (
    MappingProxyType(
        {
            "overall test": overall_test,
            "raw correlation": raw_correlation,
            "forward BIC": forward_bic,
            "sparse regression": sparse_regression,
        }
    )
)


def _explained(columns: Floats, residuals: Floats) -> float:
    basis = _spanned(columns)
    return float(np.sum((basis.T @ residuals) ** 2))


def _spanned(columns: Floats) -> Floats:
    """Find an orthonormal basis of a few columns, (n_rows, rank)."""
    squares, turns = np.linalg.eigh(columns.T @ columns)
    largest = max(float(squares[-1]), 1e-300)
    is_visible = squares > max(_INVISIBLE * largest, _LEAST**2)
    spanned: Floats = columns @ (turns[:, is_visible] / np.sqrt(squares[is_visible]))
    return spanned
