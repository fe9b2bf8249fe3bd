"""Clusters of left-out poses: blunders are anywhere, a fault is not.

A scan statistic: over every covariate each window that begins and ends with a pose
left out is tested: how likely is it that so many of its poses are among those left out
(hypergeometric), and likewise every artefact. The smallest of all these p-values is
compared with what it is where as many poses are left out at random, drawn many times;
so windows, covariates and their kinship are all accounted for.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from traverse.arrays import Booleans, Floats, Integers

# A covariate: its name like a column of the campaign, its joint's name or None, and
# the value of every pose that might have taken part, (n_poses,).
Line = tuple[str, str | None, Floats]

ARTEFACT = "artefact"
# Probability that poses left out at random are reported as a cluster.
LEVEL = 1e-3
_LEAST = 3
# Windows with more of them are not looked at.
_MOST = 40
_TAIL = 0.1


@dataclass(frozen=True, slots=True)
class Cluster:
    """A cluster of poses that were left out.

    Attributes:
        covariate: Named like a column of the campaign.
        joint: Whose it is; None: of the whole arm.
        artefact: Its name, where it is poses of one artefact; or None.
        low: Of the covariate; NaN for an artefact.
        high: Likewise.
        n_excluded: Poses there that were left out.
        log_p: That chance would bring so many together anywhere.
    """

    covariate: str
    joint: str | None
    artefact: str | None
    low: float
    high: float
    n_excluded: int
    n_poses: int
    log_p: float


@dataclass(frozen=True, slots=True)
class ExcludedCluster:
    """Where excluded poses lay together, and whether they take part again."""

    cluster: Cluster
    taken_back: bool


def find_outlier_cluster(
    lines: Sequence[Line],
    artefacts: Integers,
    artefact_names: Sequence[str],
    included: Booleans,
    *,
    n_draws: int,
    seed: int,
) -> Cluster | None:
    """Find a cluster of poses that were left out.

    Args:
        lines: Covariates of the poses that might have taken part.
        artefacts: Which artefact each of these touches, (n_poses,).
        artefact_names: Of all artefacts.
        included: Which of them did take part, (n_poses,).
        n_draws: Of as many poses at random.
        seed: Of the draws.

    Returns:
        The most significant cluster; None if consistent with chance.
    """
    n_poses, out = len(included), np.flatnonzero(~included)
    if len(out) < _LEAST:
        return None
    tails = _log_tails(n_poses, len(out))
    places = list(_of_artefacts(artefact_names, artefacts, out))
    places += [place for line in lines for place in _windows(*line, out)]
    log_p = np.array([tails[place.n_excluded, place.n_poses] for place in places])
    # By chance it occurs somewhere at least as often as there.
    if np.min(log_p, initial=0.0) > np.log(LEVEL):
        return None
    rng = np.random.default_rng(seed)
    draws = np.array([rng.permutation(n_poses)[: len(out)] for _ in range(n_draws)])
    by_chance = lowest_log_p([values for *_, values in lines], artefacts, draws)
    # Beyond a quantile that the draws know well, the tail falls with slope one.
    beyond = float(np.min(log_p) - np.quantile(by_chance, _TAIL))
    if np.log(_TAIL) + beyond > np.log(LEVEL):
        return None
    return replace(places[int(np.argmin(log_p))], log_p=float(np.log(_TAIL) + beyond))


def lowest_log_p(
    lines: Sequence[Floats], artefacts: Integers, draws: Integers
) -> Floats:
    """Find the smallest log p of all windows and artefacts of many draws, (n_draws,).

    Args:
        lines: Covariates, each (n_poses,).
        artefacts: Which artefact each pose touches, (n_poses,).
        draws: Poses that are left out in each, (n_draws, n_out).
    """
    n_out = draws.shape[1]
    tails = _log_tails(len(artefacts), n_out)
    lowest = np.zeros(len(draws))
    for values in lines:
        ranks = np.sort(_ranks(values)[draws], axis=1)
        for count in range(_LEAST, min(n_out, _MOST) + 1):
            widths = ranks[:, count - 1 :] - ranks[:, : n_out - count + 1] + 1
            # The narrowest window is the most striking one with so many.
            lowest = np.minimum(lowest, tails[count, widths.min(axis=1)])
    for artefact in np.unique(artefacts):
        mine = artefacts == artefact
        counts = np.count_nonzero(mine[draws], axis=1)
        lowest = np.minimum(lowest, tails[counts, np.count_nonzero(mine)])
    return lowest


def _windows(
    name: str, joint: str | None, values: Floats, out: Integers
) -> Iterator[Cluster]:
    """List the narrowest window with each number of poses that were left out."""
    order = np.argsort(values[out], kind="stable")
    ranks, ends = np.sort(_ranks(values)[out]), values[out][order]
    for count in range(_LEAST, min(len(out), _MOST) + 1):
        widths = ranks[count - 1 :] - ranks[: len(out) - count + 1] + 1
        first = int(np.argmin(widths))
        low, high = float(ends[first]), float(ends[first + count - 1])
        yield Cluster(name, joint, None, low, high, count, int(widths[first]), 0.0)


def _of_artefacts(
    names: Sequence[str], artefacts: Integers, out: Integers
) -> Iterator[Cluster]:
    for index in np.unique(artefacts[out]):
        count = int(np.count_nonzero(artefacts[out] == index))
        total = int(np.count_nonzero(artefacts == index))
        nan = float("nan")
        yield Cluster(ARTEFACT, None, names[index], nan, nan, count, total, 0.0)


def _ranks(values: Floats) -> Integers:
    return np.argsort(np.argsort(values, kind="stable"), kind="stable")


def _log_tails(n_poses: int, n_out: int) -> Floats:
    """Tabulate log P(at least k of a window of n poses are among those left out).

    Returns:
        (n_out + 1, n_poses + 1), by k and n.
    """
    k = np.arange(n_out + 1)[:, np.newaxis]
    n = np.arange(n_poses + 1)[np.newaxis, :]
    n_inside = n_poses - n_out
    is_possible = (k <= n) & (n - k <= n_inside)
    n_further = np.where(is_possible, n - k, 0)
    terms = (
        _log_choices(n_out, k)
        + _log_choices(n_inside, n_further)
        - _log_choices(n_poses, n)
    )
    log_p = np.where(is_possible, terms, -np.inf)
    tails = np.logaddexp.accumulate(log_p[::-1], axis=0)[::-1]
    return np.minimum(tails, 0.0)


def _log_choices(total: int, chosen: Integers) -> Floats:
    logarithms: Floats = (
        special.gammaln(total + 1.0)
        - special.gammaln(chosen + 1.0)
        - special.gammaln(total - chosen + 1.0)
    )
    return logarithms
