"""Family-wise thresholds: how small the smallest p-value of a bank is by chance.

Noise without any effect is drawn and tested like the residuals. The tail of the
smallest log p of many tests is exponential with slope one, whatever their overlap
(K p for the effective number K of tests), so the threshold is taken from the 10 %
point of the draws, which is known well, and the slope.
"""

from collections.abc import Callable

import numpy as np

from traverse.arrays import Floats
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate, log_p_values
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

# Takes draws (n_rows, n_draws); returns per draw the largest T and its degrees.
Scan = Callable[[Floats], tuple[Floats, int]]

_TAIL = 0.1


def noise_draws(rows: ObservationEquations, n_draws: int, seed: int) -> Floats:
    """Draw residuals of pure noise of unit weight, (n_rows, n_draws)."""
    rng = np.random.default_rng(seed)
    return rows.project(rng.standard_normal((len(rows.values), n_draws)))


def log_p_threshold(
    rows: ObservationEquations,
    projected: tuple[ProjectedCandidate, ...],
    draws: Floats,
    level: float,
    scans: tuple[Scan, ...] = (),
) -> float:
    """Find the log p that the smallest of a bank falls below with some probability.

    Args:
        rows: Of the fit.
        projected: The bank.
        draws: Residuals of pure noise, (n_rows, n_draws).
        level: Probability of a false alarm of the whole bank.
        scans: Further tests of the bank.
    """
    totals = np.einsum("rd,rd->d", draws, draws)
    lowest = np.zeros(draws.shape[1])
    degrees = np.array([len(one.singular_values) for one in projected], dtype=np.int64)
    for size in np.unique(degrees[degrees > 0]):
        members = [p for p in projected if len(p.singular_values) == size]
        stacked = np.concatenate([p.directions for p in members], axis=1)
        squares = (stacked.T @ draws) ** 2
        largest = squares.reshape(len(members), size, -1).sum(axis=1).max(axis=0)
        lowest = np.minimum(lowest, _log_p(rows, largest / totals, int(size)))
    for scan in scans:
        largest, size = scan(draws)
        lowest = np.minimum(lowest, _log_p(rows, largest / totals, size))
    return float(np.quantile(lowest, _TAIL) + np.log(level / _TAIL))


def _log_p(rows: ObservationEquations, parts: Floats, size: int) -> Floats:
    degrees = np.full(len(parts), size, dtype=np.int64)
    return log_p_values(parts, degrees, rows.redundancy)
