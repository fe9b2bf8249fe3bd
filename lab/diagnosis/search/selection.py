"""Which candidate is added next.

Family-wise thresholds: how small the smallest p-value of a bank is by chance.

Noise without any effect is drawn and tested like the residuals. The tail of the
smallest log p of many tests is exponential with slope one, whatever their overlap
(K p for the effective number K of tests), so the threshold is taken from the 10 %
point of the draws, which is well determined, and the slope.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.lab.diagnosis.candidates.candidate_scores import (
    CandidateScores,
    score_banks,
)
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate, log_p_values
from traverse.lab.diagnosis.model.candidate import BankName, Candidate
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

    The level is that of a false alarm of the whole bank with its scans, the draws are
    residuals of pure noise, (n_rows, n_draws).
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


# Evidence that decides between two explanations: 20 to 1.
DECIDED = float(np.log(20.0))
NAMED_BANKS = (
    BankName.LIBRARY,
    BankName.STEPS,
    BankName.HARMONIC,
    BankName.TRANSMISSION,
)
_N_PAIRED = 3


@dataclass(frozen=True, slots=True, eq=False)
class ScoredCandidate:
    """A candidate with what speaks for it.

    Attributes:
        found: Projected.
        evidence: Log Bayes factor.
        score: With the preference for its kind.
        log_p: Of its test.
        residuals: That it was judged on, (n_rows,).
    """

    found: ProjectedCandidate
    evidence: float
    score: float
    log_p: float
    bank: BankName
    residuals: Floats

    @property
    def candidate(self) -> Candidate:
        """Which."""
        return self.found.candidate


def ranked(
    stage: CandidateScores,
    names: Collection[BankName],
    joints_with_own_curve: Collection[str],
) -> list[ScoredCandidate]:
    """Sort the candidates of some banks, the best first.

    Functions of readings that have an empirical curve already are left out.
    """
    found = [
        choice
        for name in names
        for choice in _choices(stage, name)
        if not has_own_curve(choice.candidate, joints_with_own_curve)
    ]
    return sorted(found, key=lambda choice: -choice.score)


def is_significant(
    stage: CandidateScores,
    thresholds: dict[BankName, float],
    joints_with_own_curve: Collection[str],
) -> bool:
    """Return whether any bank finds anything."""
    return any(
        choice.log_p < threshold
        for name, threshold in thresholds.items()
        for choice in _choices(stage, name)
        if not has_own_curve(choice.candidate, joints_with_own_curve)
    )


def select_next(
    stage: CandidateScores, joints_with_own_curve: Collection[str]
) -> ScoredCandidate | None:
    """Choose what to add: a name if it explains as much as any curve does.

    A curve that wins may be two named effects at once: then the name that with a
    second one explains as much is first.
    """
    named = ranked(stage, NAMED_BANKS, joints_with_own_curve)
    curves = ranked(stage, (BankName.GENERIC,), joints_with_own_curve)
    if not curves:
        return named[0] if named else None
    needed = curves[0].score - DECIDED
    if named and named[0].score >= needed:
        return named[0]
    for first in named[:_N_PAIRED]:
        basis = np.hstack([stage.rows.basis, first.found.directions])
        rest = score_banks(
            replace(stage.rows, basis=basis),
            {BankName.LIBRARY: stage.banks[BankName.LIBRARY]},
        )
        seconds = ranked(rest, (BankName.LIBRARY,), joints_with_own_curve)[:1]
        if any(
            first.score + max(second.score, 0.0) >= needed
            and not fit_any_curve_together(first.candidate, second.candidate)
            for second in seconds
        ):
            return first
    adaptable = [one for one in curves if one.candidate.component == "angle"]
    if adaptable and adaptable[0].score >= curves[0].score - DECIDED:
        return adaptable[0]
    return curves[0]


def fit_any_curve_together(first: Candidate, second: Candidate) -> bool:
    """Say whether two effects go round with one joint: together they fit any curve."""
    return (
        first.joint == second.joint
        and EFFECT_KINDS[first.kind].turns_with_joint
        and EFFECT_KINDS[second.kind].turns_with_joint
    )


def has_own_curve(candidate: Candidate, joints_with_own_curve: Collection[str]) -> bool:
    """Say whether a candidate is a function of a reading that has a curve already."""
    if candidate.joint not in joints_with_own_curve:
        return False
    own_curve = candidate.covariate == f"{candidate.joint}_rad"
    return own_curve or EFFECT_KINDS[candidate.kind].family is Family.OWN_ANGLE


def _choices(stage: CandidateScores, name: BankName) -> list[ScoredCandidate]:
    findings, residuals = stage.findings[name], stage.rows.residuals
    return [
        ScoredCandidate(
            found, float(evidence), float(score), float(log_p), name, residuals
        )
        for found, evidence, score, log_p in zip(
            findings.projected,
            findings.evidences,
            findings.scores,
            findings.log_p,
            strict=True,
        )
        if len(found.singular_values)
    ]
