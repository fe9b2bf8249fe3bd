"""Propagation of distributions (GUM Supplement 1), as a check of a linear budget.

A figure is the largest of several test values, or twice their root mean square: neither
is linear. What shares a source is drawn once. Lines of the arm take no part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isinf, sqrt
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.lab.acceptance.budget import Budget, Contribution

N_DRAWS = 20_000
SEED = 1
# Part of U. Ends of so many draws scatter by 1 % of it.
AGREEMENT = 0.05

Reduction = Literal["largest", "twice rms"]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """How a figure follows from test values.

    Attributes:
        values_mm: (n,)
        budgets: n of them.
        reduction: Largest size, or twice the root mean square.
    """

    values_mm: Floats
    budgets: Sequence[Budget]
    reduction: Reduction = "largest"


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Distribution of a figure's size.

    Attributes:
        low_mm: Lower end of the interval that leaves out as much on either side.
        agrees: Whether size and U give the same ends, within `AGREEMENT` of U.
    """

    standard_mm: float
    low_mm: float
    high_mm: float
    agrees: bool
    draws: int = N_DRAWS
    seed: int = SEED


def propagated(
    model: Model, size_mm: float, expanded_mm: float, probability: float
) -> MonteCarlo:
    """Draw the figure, and compare it with its size and expanded uncertainty."""
    rng = np.random.default_rng(SEED)
    sizes_mm = _reduced(model.values_mm + _errors(model, rng), model.reduction)
    tail = 0.5 * (1.0 - probability)
    low_mm, high_mm = (float(end) for end in np.quantile(sizes_mm, (tail, 1.0 - tail)))
    standard_mm = float(sizes_mm.std(ddof=1))
    off_mm = max(
        abs(low_mm - (size_mm - expanded_mm)), abs(high_mm - (size_mm + expanded_mm))
    )
    agrees = off_mm <= AGREEMENT * expanded_mm
    return MonteCarlo(standard_mm, low_mm, high_mm, agrees)


def _reduced(values_mm: Floats, reduction: Reduction) -> Floats:
    sizes_mm: Floats = (
        np.abs(values_mm).max(axis=1)
        if reduction == "largest"
        else 2.0 * np.sqrt(np.mean(values_mm**2, axis=1))
    )
    return sizes_mm


def _errors(model: Model, rng: np.random.Generator) -> Floats:
    """Draw errors of all values, (N_DRAWS, n)."""
    errors_mm = np.zeros((N_DRAWS, len(model.values_mm)))
    shared: dict[str, Floats] = {}
    for column, budget in enumerate(model.budgets):
        for line in budget.of_test:
            if not line.signed_mm:
                continue
            units = shared.get(line.source)
            if units is None:
                units = _drawn(line, rng)
            if line.source:
                shared[line.source] = units
            errors_mm[:, column] += line.signed_mm * units
    return errors_mm


def _drawn(line: Contribution, rng: np.random.Generator) -> Floats:
    """Draw a quantity in standard uncertainties, (N_DRAWS,)."""
    if not isinf(line.degrees):
        return rng.standard_t(line.degrees, N_DRAWS)
    if line.distribution == "uniform":
        return rng.uniform(-sqrt(3.0), sqrt(3.0), N_DRAWS)
    return rng.standard_normal(N_DRAWS)
