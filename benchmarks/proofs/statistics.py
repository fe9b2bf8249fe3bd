"""Verdicts over many campaigns, in lines of tables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import (
    beta,
    chi2,
)

from benchmarks.proofs.trials import Outcome

LOW, HIGH = 0.001, 0.999
# Of the interval for the share of passed tests: seven mixes that are right leave
# theirs, any of them, in one run of twenty.
_LEVEL = 1.0 - 0.05 / 7
# Sums of squares may differ from what the planted errors must leave by this part of
# their standard deviation: all of them shifted by that cost the level 0.3 points.
_FARTHEST = 0.1


@dataclass(frozen=True, slots=True)
class Verdict:
    """A line of a table, and whether its claim holds."""

    line: str
    holds: bool


def binomial_interval(n_yes: int, n: int, level: float = _LEVEL) -> tuple[float, float]:
    """Bound a probability by Clopper and Pearson."""
    tail = 0.5 * (1.0 - level)
    low = float(beta.ppf(tail, n_yes, n - n_yes + 1)) if n_yes else 0.0
    high = float(beta.ppf(1.0 - tail, n_yes + 1, n - n_yes)) if n_yes < n else 1.0
    return low, high


CLEAN_HEADER = (
    "| mix | converged | determined | sigma0 test passed | 99.3 % interval | "
    "farthest from foreseen | sigma0 pooled | chi-square of distances | "
    "0.1 % ... 99.9 % points | holds |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def clean_verdict(mix: str, outcomes: Sequence[Outcome]) -> Verdict:
    n = len(outcomes)
    n_passed = sum(o.passed for o in outcomes)
    low, high = binomial_interval(n_passed, n)
    square = sum(o.chi_square for o in outcomes)
    degrees = sum(o.degrees for o in outcomes)
    least, most = (float(chi2.ppf(p, degrees)) for p in (LOW, HIGH))
    sigma0 = np.sqrt(
        sum(o.sum_of_squares for o in outcomes) / sum(o.redundancy for o in outcomes)
    )
    counts = sorted({o.n_determined for o in outcomes})
    n_converged = sum(o.converged for o in outcomes)
    farthest = _farthest(outcomes)
    holds = n_converged == n and least <= square <= most
    holds = holds and low <= 0.95 <= high and farthest <= _FARTHEST
    line = (
        f"| {mix} | {n_converged}/{n} | {', '.join(map(str, counts))} | "
        f"{n_passed / n:.1%} | {low:.1%} ... {high:.1%} | {farthest:.3f} | "
        f"{sigma0:.4f} | {square:.0f} | {least:.0f} ... {most:.0f} | {_word(holds)} |"
    )
    return Verdict(line, holds)


BLUNDER_HEADER = (
    "| mix | blunders | campaigns | spoilt poses | removed | left | good poses lost | "
    "spread over clean | chi-square / degrees | holds |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def blunder_verdict(
    mix: str, share: float, outcomes: Sequence[Outcome], clean: Sequence[Outcome]
) -> Verdict:
    """Judge campaigns with blunders by the same ones without."""
    n_blunders = sum(o.n_blunders for o in outcomes)
    n_kept = sum(o.n_kept for o in outcomes)
    ratio = _spread_mm(outcomes) / _spread_mm(clean[: len(outcomes)])
    square = sum(o.chi_square for o in outcomes) / sum(o.degrees for o in outcomes)
    holds = n_kept == 0 and ratio <= 1.1
    line = (
        f"| {mix} | {share:.0%} | {len(outcomes)} | {n_blunders} | "
        f"{n_blunders - n_kept} | {n_kept} | {sum(o.n_lost for o in outcomes)} | "
        f"{ratio:.3f} | {square:.3f} | {_word(holds)} |"
    )
    return Verdict(line, holds)


def _farthest(outcomes: Sequence[Outcome]) -> float:
    """Return the largest departure from the prediction, in its standard deviations.

    Of sums of squares and of the distances' chi-squares; infinite if equations less
    unknowns were counted wrong.
    """
    gaps = [0.0]
    for o in outcomes:
        if o.foreseen is None or o.foreseen_chi_square is None:
            continue
        if o.redundancy != o.foreseen_redundancy:
            return float("inf")
        gaps += [
            abs(o.sum_of_squares - o.foreseen) / np.sqrt(2.0 * o.redundancy),
            abs(o.chi_square - o.foreseen_chi_square) / np.sqrt(2.0 * o.degrees),
        ]
    return float(max(gaps))


def _spread_mm(outcomes: Sequence[Outcome]) -> float:
    """Root mean square of distances' errors over all campaigns."""
    return float(np.sqrt(np.mean([o.mean_square_mm2 for o in outcomes])))


def _word(holds: bool) -> str:
    return "yes" if holds else "NO"
