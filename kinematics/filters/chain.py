"""All filters by name, and chains of them."""

from collections.abc import Sequence

from traverse.kinematics.filters.point_filter import PointBlock, PointFilter
from traverse.kinematics.filters.sections import Sections
from traverse.kinematics.filters.selections import Ball, Box, Slab, Speed, Unflagged
from traverse.kinematics.filters.thinning import BallSpacing, Distance, GridSpacing

FILTERS: dict[str, type[PointFilter]] = {
    made.kind: made
    for made in (
        Ball,
        BallSpacing,
        Box,
        Distance,
        GridSpacing,
        Sections,
        Slab,
        Speed,
        Unflagged,
    )
}
"""By name in configurations and commands."""


class FilterChain:
    """Filters in series.

    Args:
        filters: in order; regions first are the cheapest.

    Attributes:
        removed: points removed by each filter; 0 for one that interpolates.
    """

    def __init__(self, filters: Sequence[PointFilter]) -> None:
        self.filters = tuple(filters)
        self.removed = [0] * len(self.filters)

    @property
    def interpolates(self) -> bool:
        return any(made.interpolates for made in self.filters)

    def apply(self, block: PointBlock) -> PointBlock:
        for number, stage in enumerate(self.filters):
            n_before = len(block)
            if not n_before:
                break
            block = stage.apply(block)
            if not stage.interpolates:
                self.removed[number] += n_before - len(block)
        return block

    def restart(self) -> None:
        for stage in self.filters:
            stage.restart()
