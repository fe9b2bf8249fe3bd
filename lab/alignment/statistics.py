"""Tests of an alignment, and what they could have revealed."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

# W. Baarda's usual choice for one coordinate: 0.1 % false alarms, 80 % found.
POINT_LEVEL = 0.001
GLOBAL_LEVEL = 0.05
POWER = 0.8
# Errors of one coordinate that are found so, in standard deviations of what is seen.
FOUND = float(special.ndtri(1.0 - 0.5 * POINT_LEVEL) + special.ndtri(POWER))


@dataclass(frozen=True, slots=True, eq=False)
class GlobalTest:
    """Whether errors are as large as stated.

    Attributes:
        sigma0: Found over stated; or, where nothing is stated, in mm.
        redundancy: Of sigma0.
        interval: In which the true sigma0 lies with 95 %.
        p_value: Of sigma0 being so large by chance; None where nothing is stated.
        found_factor: So many times too large errors have to be all over to be found
            with a probability of 80 %.
        found_noncentrality: What an error has to add to the sum of squares for that.
    """

    sigma0: float
    redundancy: int
    interval: tuple[float, float]
    p_value: float | None
    found_factor: float
    found_noncentrality: float

    @property
    def passed(self) -> bool | None:
        """Whether it passed; None where nothing can be tested."""
        return None if self.p_value is None else self.p_value >= GLOBAL_LEVEL

    def values(self) -> dict[str, Any]:
        """As in alignment.json."""
        return {
            "p_value": self.p_value,
            "level": GLOBAL_LEVEL,
            "passed": self.passed,
            "power": POWER,
            "found_factor": None if self.p_value is None else self.found_factor,
            "found_noncentrality": self.found_noncentrality,
        }


def global_test(
    sum_of_squares: float, redundancy: int, *, is_stated: bool
) -> GlobalTest | None:
    """Test whether the sum of squares is chi-squared; None without redundancy.

    Args:
        sum_of_squares: Weighted.
        redundancy: Its degrees of freedom.
        is_stated: Whether the weights are stated errors, not just ratios.
    """
    if redundancy <= 0:
        return None
    sigma0 = float(np.sqrt(sum_of_squares / redundancy))
    low, high = (float(special.chdtri(redundancy, p)) for p in (0.975, 0.025))
    critical = float(special.chdtri(redundancy, GLOBAL_LEVEL))
    return GlobalTest(
        sigma0,
        redundancy,
        (sigma0 * np.sqrt(redundancy / high), sigma0 * np.sqrt(redundancy / low)),
        float(special.chdtrc(redundancy, sum_of_squares)) if is_stated else None,
        float(np.sqrt(critical / special.chdtri(redundancy, POWER))),
        float(special.chndtrinc(critical, redundancy, 1.0 - POWER)),
    )


def point_p_value(statistic: float, degrees: int) -> float | None:
    """Test a point; None where nothing of it is seen."""
    return float(special.chdtrc(degrees, statistic)) if degrees else None
