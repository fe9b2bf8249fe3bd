"""Alignment of the part: best fit, 3-2-1, leapfrog."""
