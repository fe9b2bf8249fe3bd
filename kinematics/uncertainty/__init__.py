"""Uncertainty of an arm and of the points that it measures."""
