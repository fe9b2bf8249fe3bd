"""Tails of distributions, and the global test of an adjustment by them."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from traverse.arrays import Floats

GLOBAL_LEVEL = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class GlobalTest:
    """Whether errors are as large as stated: a chi-square test of sigma0 at 5 %.

    Attributes:
        p_value: Of sigma0 being so far off by chance; None where nothing is stated.
        noise_estimated: The noise was estimated from the same residuals: sigma0 is 1 by
            construction, and the test says nothing.
    """

    p_value: float | None
    noise_estimated: bool = False

    @property
    def passed(self) -> bool | None:
        """Whether it passed; None where nothing can be tested."""
        return None if self.p_value is None else self.p_value >= GLOBAL_LEVEL


def chi_square_p_value(statistic: float, degrees: float) -> float:
    """Return how likely a sum of squares is at least this large."""
    return float(special.chdtrc(degrees, statistic))


def chi_square_log_tail(statistics: Floats, degrees: Floats) -> Floats:
    """Compute log P(chi^2 > statistic), also where P underflows, (n,)."""
    with np.errstate(divide="ignore"):
        log_tails = np.log(special.chdtrc(degrees, statistics))
    half = 0.5 * np.maximum(statistics, 1.0)
    far = -half + (0.5 * degrees - 1.0) * np.log(half) - special.gammaln(0.5 * degrees)
    tails: Floats = np.where(statistics > 1000.0, far, log_tails)
    return tails


def equivalent_normal(statistics: Floats, degrees: Floats) -> Floats:
    """Turn chi-square statistics into |w| of a normal with the same p-value, (n,).

    With one degree of freedom this is the square root. Without any: zero.
    """
    safe = np.maximum(degrees, 1.0)
    log_tails = chi_square_log_tail(statistics, safe)
    # Near one the tail is indistinguishable from one; w is near zero there.
    normal = -special.ndtri_exp(np.minimum(log_tails - np.log(2.0), -np.log(2.0)))
    w: Floats = np.where(degrees == 1.0, np.sqrt(np.maximum(statistics, 0.0)), normal)
    return np.where(degrees > 0.0, w, 0.0)


def normal_quantile(probability: float) -> float:
    return float(special.ndtri(probability))


def student_critical(alpha: float, redundancy: int) -> float:
    """Compute Student's critical |t| of two-sided level alpha.

    Of a value that took no part in an adjustment, as Pope's tau is of one that did.
    """
    return float(special.stdtrit(max(redundancy, 1), 1.0 - 0.5 * alpha))


def tau_critical(alpha: float, redundancy: int) -> float:
    """Compute Pope's critical |tau| of two-sided level alpha.

    tau = t sqrt(r) / sqrt(r - 1 + t^2) with Student's t of r - 1 degrees.
    """
    if redundancy <= 1:
        return float("inf")
    t = student_critical(alpha, redundancy - 1)
    return float(t * np.sqrt(redundancy) / np.sqrt(redundancy - 1 + t * t))


def median_of_chi_square(degrees: int) -> float:
    return float(special.chdtri(degrees, 0.5))


def excess_p_value(n_found: int, of: int, others_found: int, of_others: int) -> float:
    """Return how likely at least so many are found here, if they are as many there.

    Fisher's exact test of a 2 x 2 table, one-sided: the tail of the hypergeometric
    distribution. `scipy.stats`, which has it, takes longer to import than all else.
    """
    total = n_found + others_found

    def log_ways(n: int, k: Floats | int) -> Floats:
        ways: Floats = -special.gammaln(np.add(k, 1.0))
        ways -= special.gammaln(np.subtract(n, k) + 1.0)
        return ways + float(special.gammaln(n + 1.0))

    counts = np.arange(n_found, min(of, total) + 1.0)
    counts = counts[total - counts <= of_others]
    logs = log_ways(of, counts) + log_ways(of_others, total - counts)
    return float(np.sum(np.exp(logs - log_ways(of + of_others, total))))


def global_test(
    sigma0: float, redundancy: float, *, noise_estimated: bool
) -> GlobalTest:
    """Test sigma0 against 1, two-sided; the redundancy counts independent squares."""
    if redundancy <= 0:
        return GlobalTest(p_value=None, noise_estimated=noise_estimated)
    upper = chi_square_p_value(sigma0**2 * redundancy, redundancy)
    p_value = 2.0 * min(upper, 1.0 - upper)
    return GlobalTest(p_value=p_value, noise_estimated=noise_estimated)


def variance_factor(sigma0: float, test: GlobalTest) -> float:
    """Return the factor between cofactors and covariances.

    One where the noise is known and sigma0 does not contradict it upwards: the
    estimate of sigma0 would only add its own uncertainty. Else sigma0 squared.
    """
    is_plausible = bool(test.passed) or sigma0 < 1.0
    if is_plausible and not test.noise_estimated:
        return 1.0
    return sigma0**2


def arm_variance_factor(
    factor: float, test: GlobalTest, redundancy: float, n_parameters: int
) -> float:
    """Return the factor of what is determined of an arm; never below the one given.

    Strategy: sigma0 squared is right where the noise is larger than stated. Where the
    model lacks something, residuals show only what the parameters did not take up, and
    it does not average out: a new posture is off by as much as a measured one, at
    least. So the arm gets all that noise does not explain. With cofactors as they are
    it takes n_parameters of the squares, of which there are (sigma0^2 - 1) redundancy
    in excess.
    """
    if test.noise_estimated or n_parameters == 0:
        return factor
    return max(factor, 1.0 + (factor - 1.0) * redundancy / n_parameters)
