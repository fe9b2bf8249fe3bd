"""Verdicts over many campaigns, in lines of tables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import (  # type: ignore[import-untyped] # scipy ships no types
    beta,
    chi2,
)

from benchmarks.proofs.trials import Outcome

LOW, HIGH = 0.01, 0.99


@dataclass(frozen=True, slots=True)
class Verdict:
    """A line of a table, and whether what it should show holds."""

    line: str
    holds: bool


def binomial_interval(n_yes: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Bound a probability by Clopper and Pearson."""
    tail = 0.5 * (1.0 - level)
    low = float(beta.ppf(tail, n_yes, n - n_yes + 1)) if n_yes else 0.0
    high = float(beta.ppf(1.0 - tail, n_yes + 1, n - n_yes)) if n_yes < n else 1.0
    return low, high


CLEAN_HEADER = (
    "| mix | converged | determined | sigma0 test passed | 95 % interval | "
    "sigma0 pooled | chi-square of distances | 1 % ... 99 % points | holds |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def clean_verdict(mix: str, found: Sequence[Outcome]) -> Verdict:
    """Judge campaigns without blunders."""
    n = len(found)
    n_passed = sum(o.passed for o in found)
    low, high = binomial_interval(n_passed, n)
    square = sum(o.chi_square for o in found)
    degrees = sum(o.degrees for o in found)
    least, most = (float(chi2.ppf(p, degrees)) for p in (LOW, HIGH))
    sigma0 = np.sqrt(
        sum(o.sum_of_squares for o in found) / sum(o.redundancy for o in found)
    )
    counts = sorted({o.n_determined for o in found})
    n_converged = sum(o.converged for o in found)
    holds = least <= square <= most and low <= 0.95 <= high and n_converged == n
    line = (
        f"| {mix} | {n_converged}/{n} | {', '.join(map(str, counts))} | "
        f"{n_passed / n:.1%} | {low:.1%} ... {high:.1%} | {sigma0:.4f} | "
        f"{square:.0f} | {least:.0f} ... {most:.0f} | {_word(holds)} |"
    )
    return Verdict(line, holds)


BLUNDER_HEADER = (
    "| mix | blunders | campaigns | spoilt poses | removed | left | good poses lost | "
    "spread over clean | chi-square / degrees | holds |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def blunder_verdict(
    mix: str, share: float, found: Sequence[Outcome], clean: Sequence[Outcome]
) -> Verdict:
    """Judge campaigns with blunders by the same ones without."""
    n_blunders = sum(o.n_blunders for o in found)
    n_kept = sum(o.n_kept for o in found)
    ratio = _spread_mm(found) / _spread_mm(clean[: len(found)])
    square = sum(o.chi_square for o in found) / sum(o.degrees for o in found)
    holds = n_kept == 0 and ratio <= 1.1
    line = (
        f"| {mix} | {share:.0%} | {len(found)} | {n_blunders} | "
        f"{n_blunders - n_kept} | {n_kept} | {sum(o.n_lost for o in found)} | "
        f"{ratio:.3f} | {square:.3f} | {_word(holds)} |"
    )
    return Verdict(line, holds)


def _spread_mm(found: Sequence[Outcome]) -> float:
    """Root mean square of distances' errors over all campaigns."""
    return float(np.sqrt(np.mean([o.mean_square_mm2 for o in found])))


def _word(holds: bool) -> str:
    return "yes" if holds else "NO"
