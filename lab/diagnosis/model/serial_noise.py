"""Serially correlated noise of rows: its test, its estimate, and rows without it.

Readings and contacts drift a little during the day: a part `share` of their variance
then has the correlation phi^l between poses l apart, in the order of time. The rows'
errors have the correlation

    R_ij = (1 - share) delta_ij + share phi^|t_i - t_j| s_i . s_j

with s_i the row's sources in units of their noise. Who takes such noise for white takes
it for drifts.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from traverse.arrays import Floats, Integers
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    decorrelated_equations,
)

_MOST_LAG = 25
_TEST_PHI = 0.9
_PHIS = (0.7, 0.8, 0.9, 0.95, 0.98)
_LARGEST_SHARE = 0.9
_LIKELY_SHARES = (0.2, 0.35, 0.5)


@dataclass(frozen=True, slots=True)
class SerialCorrelation:
    """Correlated part of the noise: share of its variance, phi from pose to pose."""

    share: float
    phi: float


def is_serially_correlated(
    rows: ObservationEquations, draws: Floats, level: float
) -> bool:
    """Test residuals for serial correlation.

    Against draws of the residuals of white noise, (n_rows, n_draws).
    """
    weights = _TEST_PHI ** np.arange(1, _MOST_LAG + 1)
    many = np.column_stack([rows.residuals, draws])
    products, _ = _lagged(rows, many)
    correlations = weights @ products / np.einsum("rd,rd->d", many, many)
    return bool(correlations[0] > np.quantile(correlations[1:], 1.0 - level))


def serial_correlation(rows: ObservationEquations) -> SerialCorrelation:
    """Estimate share and correlation from the products of residuals at every lag."""
    residuals = rows.residuals[:, np.newaxis]
    products, weights = _lagged(rows, residuals)
    variance = rows.sum_of_squares / rows.redundancy
    best, least = SerialCorrelation(0.0, 0.0), np.inf
    lags = np.arange(1, _MOST_LAG + 1)
    for phi in _PHIS:
        model = weights * phi**lags
        share = float(products[:, 0] @ phi**lags / variance / (model @ phi**lags))
        share = float(np.clip(share, 0.0, _LARGEST_SHARE))
        correlations = products[:, 0] / variance / np.maximum(weights, 1e-12)
        misfit = float(np.sum(weights * (correlations - share * phi**lags) ** 2))
        if misfit < least:
            best, least = SerialCorrelation(share, phi), misfit
    return best


def likeliest_serial_noise(
    rows: ObservationEquations,
) -> tuple[SerialCorrelation, float]:
    """Find the likeliest serial noise, and its `serial_evidence`.

    Strategy: the unknowns absorb a part of what is slow, which products of residuals do
    not know of, but the restricted likelihood does. Each of its values costs as much as
    a fit of dense rows, and it is flat in the share, so that few are tried.
    """
    least, middle, largest = _LIKELY_SHARES
    evidences = {
        noise: serial_evidence(rows, noise)
        for noise in (SerialCorrelation(middle, phi) for phi in _PHIS)
    }
    phi = max(evidences, key=lambda noise: evidences[noise]).phi
    for share in (least, largest):
        noise = SerialCorrelation(share, phi)
        evidences[noise] = serial_evidence(rows, noise)
    return max(evidences.items(), key=lambda pair: pair[1])


def without_serial_noise(
    rows: ObservationEquations, noise: SerialCorrelation
) -> ObservationEquations:
    """Whiten rows whose noise is correlated from pose to pose."""
    return decorrelated_equations(rows, _root(rows, noise))


def serial_evidence(rows: ObservationEquations, noise: SerialCorrelation) -> float:
    """Compute by how much likelier serial noise makes rows than white noise does.

    The natural logarithm of the ratio of restricted likelihoods, each with the variance
    that fits best; B is the basis of the unknowns' columns:

        - 1/2 (log |R| + log |B^T R^-1 B| + n log(v^T R^-1/2 P_R R^-1/2 v / v^T P v))
    """
    root = _root(rows, noise)
    basis, triangle = np.linalg.qr(
        linalg.solve_triangular(root, rows.basis, lower=True)
    )
    values = linalg.solve_triangular(root, rows.values, lower=True)
    left = values - basis @ (basis.T @ values)
    log_determinant = 2.0 * float(
        np.sum(np.log(np.diag(root))) + np.sum(np.log(np.abs(np.diag(triangle))))
    )
    ratio = float(left @ left) / rows.sum_of_squares
    return -0.5 * (log_determinant + rows.redundancy * float(np.log(ratio)))


def _root(rows: ObservationEquations, noise: SerialCorrelation) -> Floats:
    """Factor the correlation of rows, lower triangle."""
    order = _order(rows)
    apart = np.abs(order[:, np.newaxis] - order[np.newaxis, :])
    correlation = noise.share * noise.phi**apart * (rows.sources @ rows.sources.T)
    diagonal = np.arange(len(order))
    correlation[diagonal, diagonal] += 1.0 - noise.share
    certified = rows.poses < 0
    correlation[certified, :] = 0.0
    correlation[:, certified] = 0.0
    correlation[diagonal[certified], diagonal[certified]] = 1.0
    return np.linalg.cholesky(correlation)


def _order(rows: ObservationEquations) -> Integers:
    """Number the poses of all rows in the order of time, (n_rows,)."""
    times_s = rows.adjustment.network.campaign.poses.time_s
    used = rows.used_poses
    sorted_poses = used[np.argsort(times_s[used], kind="stable")]
    numbers = np.full(len(times_s) + 1, -1, dtype=np.int64)
    numbers[sorted_poses] = np.arange(len(sorted_poses))
    return numbers[rows.poses]


def rows_by_pose(numbers: Integers, values: Floats) -> Floats:
    """Sort rows by the number of their pose, below 0 none: (n_poses, 3 or 6, ...).

    A pose has up to three rows, with orientations six; absent ones are zero.
    """
    rows = np.flatnonzero(numbers >= 0)
    rows = rows[np.argsort(numbers[rows], kind="stable")]
    poses = numbers[rows]
    within = np.arange(len(rows)) - np.searchsorted(poses, poses)
    n_each = 6 if np.any(within >= 3) else 3
    by_pose = np.zeros((int(poses.max(initial=-1)) + 1, n_each, *values.shape[1:]))
    by_pose[poses, within] = values[rows]
    return by_pose


def _lagged(rows: ObservationEquations, residuals: Floats) -> tuple[Floats, Floats]:
    """Sum products of residuals, (n_rows, n_many), of poses some steps apart.

    For every lag, the sum of v_t^T K v_(t+l), (n_lags, n_many), with K the correlation
    that common sources would give, and the sum of squares of K.
    """
    order = _order(rows)
    values, sources = rows_by_pose(order, residuals), rows_by_pose(order, rows.sources)
    n_poses = len(values)
    products = np.zeros((_MOST_LAG, residuals.shape[1]))
    weights = np.zeros(_MOST_LAG)
    for lag in range(1, min(_MOST_LAG, n_poses - 1) + 1):
        common = sources[:-lag] @ sources[lag:].swapaxes(1, 2)
        products[lag - 1] = np.einsum(
            "tid,tid->d", values[:-lag], common @ values[lag:]
        )
        weights[lag - 1] = float(np.sum(common**2))
    return products, weights
