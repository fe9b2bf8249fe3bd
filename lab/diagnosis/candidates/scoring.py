"""Judging candidates: the part of what is left over that each of them explains.

With the projected block P C = U S W^T of a candidate and z = U^T v of the residuals v,

    T = |z|^2      its score statistic; F with T_0 = |v|^2 where the noise level is
                   not known (here always)
    evidence       log of the Bayes factor against nothing missing, with the prior
                   N(0, k^2 scale^2) of the amplitudes and k chosen best, at a cost

Statistics of blocks of different size are never compared, evidences are (diagnosis
after Teunissen; evidence after Jeffreys and Zellner).
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from traverse.arrays import Floats, Integers
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import Candidate

# Factors of the plausible size that are tried, and what an unusual one costs.
_FACTORS = 10.0 ** np.linspace(-1.5, 1.5, 31)
_FACTOR_PRIOR = 0.5 * (np.log10(_FACTORS) / 0.7) ** 2
# Directions that move the data less than this at the largest factor are undetectable.
LEAST_SINGULAR_VALUE = 0.016
# Part of what a compliance explains that expected moments have to explain.
_USUAL = 0.5
# Below this logarithm a p-value is summed by its series.
_FAR_TAIL = -600.0
# Of the squared singular values: what rounding leaves of a direction that vanishes.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedCandidate:
    """Columns of a candidate after projection on the complement of the unknowns.

    Attributes:
        directions: U, orthonormal, (n_rows, n_visible).
        singular_values: S, (n_visible,).
        combinations: W, in units of the scales, (n_columns, n_visible).
    """

    candidate: Candidate
    directions: Floats
    singular_values: Floats
    combinations: Floats

    def amplitudes(self, residuals: Floats) -> tuple[Floats, Floats]:
        """Estimate the columns' amplitudes, invisible directions left at zero.

        In the unit of the keys, (n_columns,), and their covariance for noise of unit
        weight.
        """
        scales = np.array(self.candidate.scales)
        inverse = scales[:, np.newaxis] * self.combinations / self.singular_values
        return inverse @ (self.directions.T @ residuals), inverse @ inverse.T

    @property
    def shows_itself(self) -> bool:
        """Whether the poses can show it.

        Not a compliance where no mass is known: what it does rests on assumed ones.
        """
        is_gravity = EFFECT_KINDS[self.candidate.kind].family is Family.GRAVITY
        rests_on_assumed = is_gravity and self.candidate.size > 1
        return len(self.singular_values) > 0 and not rests_on_assumed

    def is_plausible(self, residuals: Floats) -> bool:
        """Return whether a compliance is one: positive, of an arm of usual build.

        Of what it explains with moments of its own, half has to be explained with those
        that the arm is expected to have. Always of what has no moments beside.
        """
        if EFFECT_KINDS[self.candidate.kind].family is not Family.GRAVITY:
            return True
        if self.candidate.size == 1:  # masses are known
            return True
        along = self.directions.T @ residuals
        usual = self.singular_values * self.combinations[0]
        positive = max(float(along @ usual), 0.0)
        return positive**2 > _USUAL * float(usual @ usual) * float(along @ along)


@dataclass(frozen=True, slots=True, eq=False)
class BankScores:
    """All candidates of a bank, judged.

    Attributes:
        statistics: T, (n_candidates,).
        degrees: q, the number of visible directions, (n_candidates,).
        log_p: Natural logarithm of the p-values, (n_candidates,).
        evidences: Log Bayes factors, (n_candidates,).
    """

    projected: tuple[ProjectedCandidate, ...]
    statistics: Floats
    degrees: Integers
    log_p: Floats
    evidences: Floats

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        return tuple(projected.candidate for projected in self.projected)

    @property
    def scores(self) -> Floats:
        """Evidence with the preference for each kind: for ranking only."""
        priors = [projected.candidate.log_prior for projected in self.projected]
        scores: Floats = self.evidences + np.array(priors)
        return scores


def project(rows: ObservationEquations, bank: Bank) -> tuple[ProjectedCandidate, ...]:
    """Project the columns of a bank and find what is visible of them."""
    if not bank.candidates:
        return ()
    slices = bank.slices
    sizes = np.array([candidate.size for candidate in bank.candidates])
    n = bank.columns.shape[1]
    projected: dict[int, ProjectedCandidate] = {}
    for size in np.unique(sizes):
        members = np.flatnonzero(sizes == size)
        # A size at a time: all projected columns of a large campaign fill the memory.
        where = np.concatenate(
            [np.arange(*slices[index].indices(n)) for index in members]
        )
        columns = rows.project(bank.columns[:, where])
        blocks = columns.T.reshape(len(members), size, len(columns))
        values, vectors = np.linalg.eigh(blocks @ blocks.swapaxes(1, 2))
        for index, squares, turns, block in zip(
            members, values, vectors, blocks, strict=True
        ):
            least = max(LEAST_SINGULAR_VALUE**2, _ROUNDING * float(squares[-1]))
            visible = squares > least
            singular_values = np.sqrt(squares[visible])
            combinations = turns[:, visible]
            projected[int(index)] = ProjectedCandidate(
                bank.candidates[index],
                block.T @ (combinations / singular_values),
                singular_values,
                combinations,
            )
    return tuple(projected[index] for index in range(len(bank.candidates)))


def judge(
    rows: ObservationEquations, projected: tuple[ProjectedCandidate, ...]
) -> BankScores:
    """Test every candidate on the residuals of a fit."""
    total, redundancy = rows.sum_of_squares, rows.redundancy
    n, coarseness = len(projected), rows.coarseness
    degrees = np.array([len(p.singular_values) for p in projected], dtype=np.int64)
    widest = int(degrees.max(initial=0))
    along = np.zeros((n, widest))
    squares = np.zeros((n, widest))
    for index, candidate in enumerate(projected):
        along[index, : degrees[index]] = candidate.directions.T @ rows.residuals
        squares[index, : degrees[index]] = (coarseness * candidate.singular_values) ** 2
    statistics = np.sum(along**2, axis=1)
    return BankScores(
        projected,
        statistics,
        degrees,
        log_p_values(statistics / total, degrees, redundancy),
        log_evidences(along**2, squares, total, redundancy),
    )


def log_evidences(
    along_squared: Floats, singular_squared: Floats, total: float, redundancy: int
) -> Floats:
    """Compute log Bayes factors with the noise level integrated out.

        log BF(k) = - r/2 log(1 - S/T_0) - 1/2 sum log(1 + k^2 s^2),
        S = sum k^2 s^2 / (1 + k^2 s^2) z^2

    From z^2 and s^2, (..., n_directions) each, zero where there is none, the total T_0
    and the redundancy r; the largest over the factors k less what an unusual k costs,
    (...,).
    """
    best = np.full(along_squared.shape[:-1], -np.inf)
    for factor, cost in zip(_FACTORS, _FACTOR_PRIOR, strict=True):
        grown = factor**2 * singular_squared
        explained = np.sum(grown / (1.0 + grown) * along_squared, axis=-1)
        part = np.minimum(explained / total, 1.0 - 1e-12)
        occam = 0.5 * np.sum(np.log1p(grown), axis=-1)
        evidences = -0.5 * redundancy * np.log1p(-part) - occam - cost
        best = np.maximum(best, evidences)
    return best


def log_p_values(parts: Floats, degrees: Integers, redundancy: int) -> Floats:
    """Compute log p of F tests of T/T_0, (...,), without underflow.

    P(F > f) = I_x(a, b) with x = 1 - T/T_0, a = (r - q)/2, b = q/2, degrees q and
    redundancy r. 0 where nothing is tested: without columns, or with as many as r.
    """
    parts = np.clip(parts, 0.0, 1.0 - 1e-15)
    shown = np.maximum(degrees, 1)
    a, b = 0.5 * np.maximum(redundancy - shown, 1), 0.5 * shown
    with np.errstate(divide="ignore"):
        logarithms = np.log(special.betainc(a, b, 1.0 - parts))
    far = logarithms <= _FAR_TAIL
    if np.any(far):
        logarithms[far] = _log_of_far_tail(a[far], b[far], parts[far])
    return np.where((degrees > 0) & (degrees < redundancy), logarithms, 0.0)


def _log_of_far_tail(a: Floats, b: Floats, parts: Floats) -> Floats:
    """Compute log I_x(a, b) for x = 1 - parts, where I_x itself underflows.

    I_x(a, b) = x^a (1-x)^b / (a B(a, b)) * 2F1(a + b, 1; a + 1; x), and 2F1 is the sum
    of x^n (a+b)_n / (a+1)_n: its terms vanish, x is small in the far tail.
    """
    x = 1.0 - parts
    total, term = np.ones_like(x), np.ones_like(x)
    for n in range(200):
        term = term * x * (a + b + n) / (a + 1.0 + n)
        total = total + term
    front = a * np.log(x) + b * np.log(parts) - np.log(a) - special.betaln(a, b)
    return np.asarray(front + np.log(total))


# Two blocks that explain a finding equally well to this part are one.
ALIAS = 0.9995
