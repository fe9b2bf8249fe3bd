"""Filters of points: composable, the same in the daemon and off-line."""

from kinematics.filters.chain import FILTERS, FilterChain
from kinematics.filters.point_filter import PointFilter
from kinematics.filters.points import PointBlock

__all__ = ["FILTERS", "FilterChain", "PointBlock", "PointFilter"]
