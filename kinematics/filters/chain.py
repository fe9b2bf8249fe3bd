"""All filters by name, and several of them one after the other."""

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
"""By the name that they have in configurations and commands."""


class FilterChain:
    """Filters that a point must pass one after the other.

    Args:
        filters: in this order; regions first are the cheapest.

    Attributes:
        removed: points that each filter has held back so far; a filter that
            interpolates has none of its own.
    """

    def __init__(self, filters: Sequence[PointFilter]) -> None:
        self.filters = tuple(filters)
        self.removed = [0] * len(self.filters)

    @property
    def interpolates(self) -> bool:
        """Whether the output contains points between samples."""
        return any(made.interpolates for made in self.filters)

    def apply(self, block: PointBlock) -> PointBlock:
        """The points of a block that pass all filters."""
        for number, stage in enumerate(self.filters):
            n_before = len(block)
            if not n_before:
                break
            block = stage.apply(block)
            if not stage.interpolates:
                self.removed[number] += n_before - len(block)
        return block

    def restart(self) -> None:
        """Forget all points so far, not what was counted."""
        for stage in self.filters:
            stage.restart()
