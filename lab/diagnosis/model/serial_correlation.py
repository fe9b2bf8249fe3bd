"""Noise that is correlated from pose to pose, in the order of time.

Readings and contacts drift a little during the day: a part `share` of their
variance then has the correlation phi^l between poses l apart. The rows' errors have
the correlation

    R_ij = (1 - share) delta_ij + share phi^|t_i - t_j| s_i . s_j

with s_i the row's sources in units of their noise. Who takes such noise for white
takes it for drifts.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    decorrelated_equations,
)

_MOST_LAG = 25
_TEST_PHI = 0.9
_PHIS = (0.7, 0.8, 0.9, 0.95, 0.98)
_LARGEST_SHARE = 0.9


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
    found = weights @ products / np.einsum("rd,rd->d", many, many)
    return bool(found[0] > np.quantile(found[1:], 1.0 - level))


def serial_correlation(rows: ObservationEquations) -> SerialCorrelation:
    """Estimate share and correlation from the products of residuals at every lag."""
    one = rows.residuals[:, np.newaxis]
    products, weights = _lagged(rows, one)
    variance = rows.sum_of_squares / rows.redundancy
    best, least = SerialCorrelation(0.0, 0.0), np.inf
    lags = np.arange(1, _MOST_LAG + 1)
    for phi in _PHIS:
        model = weights * phi**lags
        share = float(products[:, 0] @ phi**lags / variance / (model @ phi**lags))
        share = float(np.clip(share, 0.0, _LARGEST_SHARE))
        found = products[:, 0] / variance / np.maximum(weights, 1e-12)
        misfit = float(np.sum(weights * (found - share * phi**lags) ** 2))
        if misfit < least:
            best, least = SerialCorrelation(share, phi), misfit
    return best


def without_serial_noise(
    rows: ObservationEquations, noise: SerialCorrelation
) -> ObservationEquations:
    """Whiten rows whose noise is correlated from pose to pose."""
    order = _order(rows)
    apart = np.abs(order[:, np.newaxis] - order[np.newaxis, :])
    correlation = noise.share * noise.phi**apart * (rows.sources @ rows.sources.T)
    at = np.arange(len(order))
    correlation[at, at] += 1.0 - noise.share
    certified = rows.poses < 0
    correlation[certified, :] = 0.0
    correlation[:, certified] = 0.0
    correlation[at[certified], at[certified]] = 1.0
    return decorrelated_equations(rows, np.linalg.cholesky(correlation))


def _order(rows: ObservationEquations) -> Integers:
    """Number the poses of all rows in the order of time, (n_rows,)."""
    times_s = rows.adjustment.network.campaign.poses.time_s
    used = rows.used_poses
    sorted_poses = used[np.argsort(times_s[used], kind="stable")]
    numbers = np.full(len(times_s) + 1, -1, dtype=np.int64)
    numbers[sorted_poses] = np.arange(len(sorted_poses))
    return numbers[rows.poses]


def _lagged(rows: ObservationEquations, residuals: Floats) -> tuple[Floats, Floats]:
    """Sum products of residuals, (n_rows, n_many), of poses some steps apart.

    For every lag, the sum of v_t^T K v_(t+l), (n_lags, n_many), with K the correlation
    that common sources would give, and the sum of squares of K.
    """
    order = _order(rows)
    seen = order >= 0
    # Up to three rows a pose, absent ones zero.
    n_poses = int(order.max()) + 1
    places = np.flatnonzero(seen)[np.argsort(order[seen], kind="stable")]
    pose = order[places]
    first = np.searchsorted(pose, pose)
    within = np.arange(len(pose)) - first
    values = np.zeros((n_poses, 3, residuals.shape[1]))
    sources = np.zeros((n_poses, 3, rows.sources.shape[1]))
    values[pose, within] = residuals[places]
    sources[pose, within] = rows.sources[places]
    products = np.zeros((_MOST_LAG, residuals.shape[1]))
    weights = np.zeros(_MOST_LAG)
    for lag in range(1, min(_MOST_LAG, n_poses - 1) + 1):
        common = sources[:-lag] @ sources[lag:].swapaxes(1, 2)
        products[lag - 1] = np.einsum(
            "tid,tid->d", values[:-lag], common @ values[lag:]
        )
        weights[lag - 1] = float(np.sum(common**2))
    return products, weights
