"""Family-wise thresholds: how small the smallest p-value of a bank is by chance.

Noise without any effect is drawn and tested like the residuals. The tail of the
smallest log p of many tests is exponential with slope one, whatever their overlap (K p
for the effective number K of tests), so the threshold is taken from the 10 % point of
the draws, which is well determined, and the slope.
"""

from collections.abc import Callable

import numpy as np

from traverse.arrays import Floats
from traverse.lab.diagnosis.candidates.candidate_scores import CandidateScores
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate, log_p_values
from traverse.lab.diagnosis.candidates.waves import log_p_of_search
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.outcomes.candidate import BankName

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

    The level is that of a false alarm of the whole bank with its scans, the draws are
    residuals of pure noise, (n_rows, n_draws).
    """
    totals = np.einsum("rd,rd->d", draws, draws)
    lowest = np.zeros(draws.shape[1])
    degrees = np.array(
        [len(candidate.singular_values) for candidate in projected], dtype=np.int64
    )
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


# How the probability of a false alarm is shared out.
_SHARES = {
    BankName.LIBRARY: 0.7,
    BankName.STEPS: 0.1,
    BankName.GENERIC: 0.1,
    BankName.HARMONIC: 0.05,
    BankName.TRANSMISSION: 0.05,
}


def family_thresholds(
    stage: CandidateScores, options: DiagnosisOptions
) -> dict[BankName, float]:
    """Find each bank's threshold of log p."""
    draws = noise_draws(stage.rows, options.n_draws, options.seed)
    thresholds: dict[BankName, float] = {
        name: log_p_threshold(
            stage.rows, findings.projected, draws, _SHARES[name] * options.level
        )
        for name, findings in stage.findings.items()
        if name not in (BankName.STEPS, BankName.TRANSMISSION)
    }
    scans = tuple(scan.largest for scan in stage.scans)
    level = _SHARES[BankName.STEPS] * options.level
    thresholds[BankName.STEPS] = log_p_threshold(stage.rows, (), draws, level, scans)
    thresholds[BankName.TRANSMISSION] = log_p_of_search(
        stage.waves, _SHARES[BankName.TRANSMISSION] * options.level
    )
    return thresholds
