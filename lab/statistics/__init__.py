"""Distributions and tests; the place that meets scipy.stats and scipy.special."""
