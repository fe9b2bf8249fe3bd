"""Means over parts of a range, where single poses are too noisy to look at."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats

_MOST_BINS = 24
_LEAST_IN_A_BIN = 5
# Few different values are groups by themselves: senses of approach, features.
_GROUPS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Means over parts of a range, each (n_bins,).

    Attributes:
        errors: Standard errors of the means.
    """

    centres: Floats
    means: Floats
    errors: Floats


def binned(covariate: Floats, values: Floats, stds: Floats | None = None) -> Bins:
    """Average values over parts of a covariate's range with equally many poses.

    Values and covariate are (n_poses,), NaN where unknown; their standard deviations
    are weights, default equal ones.
    """
    weights = np.ones_like(values) if stds is None else 1.0 / stds**2
    good = np.isfinite(covariate) & np.isfinite(values) & np.isfinite(weights)
    x, y, w = covariate[good], values[good], weights[good]
    if len(x) == 0:
        return Bins(np.empty(0), np.empty(0), np.empty(0))
    groups, places = np.unique(x, return_inverse=True)
    if len(groups) > _GROUPS:
        n_bins = int(np.clip(len(x) // (2 * _LEAST_IN_A_BIN), 1, _MOST_BINS))
        order = np.argsort(x, kind="stable")
        places = np.empty(len(x), dtype=np.int64)
        places[order] = np.arange(len(x)) * n_bins // len(x)
    n_bins = int(places.max()) + 1
    total = np.bincount(places, w, n_bins)
    means = np.bincount(places, w * y, n_bins) / total
    centres = np.bincount(places, w * x, n_bins) / total
    counts = np.bincount(places, minlength=n_bins)
    squares = np.bincount(places, w * (y - means[places]) ** 2, n_bins) / total
    kept = counts > 1
    errors = np.sqrt(squares[kept] / (counts[kept] - 1))
    return Bins(centres[kept], means[kept], errors)
