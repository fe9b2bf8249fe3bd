"""Composable filters of points, for the daemon and off-line."""

from traverse.kinematics.filters.chain import FILTERS, FilterChain
from traverse.kinematics.filters.point_filter import PointBlock, PointFilter
