"""Stations of the arm at one part: what is touched again after a move, and joined."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from traverse.arrays import Floats
from traverse.client.inspection.best_fit import BestFit
from traverse.client.inspection.systems import (
    Station,
    in_first_system,
    station_of_fit,
)
from traverse.client.inspection.values import Inspection
from traverse.protocol.messages import Point, Quality


class Stations:
    """Places of the arm's base, in the order in which it was moved there.

    Attributes:
        again: names of features as they are touched once more after a move, and as
            before, until they are joined.
        is_moved: whether it is not known where the arm stands.
    """

    def __init__(self) -> None:
        self.again: dict[str, str] = {}
        self.is_moved = False
        self._after_first: list[Station] = []
        self._number_by_point: dict[str, int] = {}
        self._rests_on: list[frozenset[str]] = []

    def move(self, again: Mapping[str, str]) -> None:
        """Have features touched once more: from here on no point has a known place."""
        self.again, self.is_moved = dict(again), True

    def refuse_while_moved(self) -> None:
        """Refuse an action that requires the place of the arm.

        Raises:
            ValueError: that is not known.
        """
        if self.is_moved:
            raise ValueError(
                "the arm was moved: touch features again, and join them first"
            )

    def take(self, point_id: str, feature: str) -> None:
        """Note at which station a point of a feature is taken."""
        if self._after_first and feature not in self.again:
            self._number_by_point[point_id] = len(self._after_first) - 1

    def join(
        self,
        fit: BestFit | None,
        touched_again: Collection[str],
        touched_before: Collection[str],
    ) -> None:
        """End the move.

        Args:
            fit: onto the same features of before; None: the arm was not moved.
            touched_again: ids of the points taken since.
            touched_before: ids of those of the same features before.
        """
        self.again, self.is_moved = {}, False
        if fit is not None:
            number = len(self._after_first)
            self._rests_on.append(frozenset((*touched_again, *touched_before)))
            self._after_first.append(station_of_fit(fit))
            self._number_by_point.update(dict.fromkeys(touched_again, number))

    def placed(
        self, points: Iterable[Point], shared_mm: Mapping[str, Floats] | str
    ) -> tuple[list[Point], Mapping[str, Floats] | str]:
        """Bring points into the first station's system, see `in_first_system`.

        All of a station are in doubt where one is that its place rests on.
        """
        held = {point.id: point for point in points}
        for number, ids in enumerate(self._rests_on):
            doubted = [p for i in ids if (p := held.get(i)) and not p.quality.ok]
            flags = dict.fromkeys(f for p in doubted for f in p.quality.flags)
            for point in [*held.values()] if flags else ():
                if self._number_by_point.get(point.id) == number:
                    every = tuple(dict.fromkeys((*point.quality.flags, *flags)))
                    quality = Quality(ok=False, flags=every)
                    held[point.id] = point.model_copy(update={"quality": quality})
        return in_first_system(
            [*held.values()], shared_mm, self._after_first, self._number_by_point
        )

    def without_places(self, inspection: Inspection) -> Inspection:
        """Drop places of features whose station is not known yet."""
        features = [
            replace(
                feature,
                problem="touched after the arm was moved, and not joined yet",
                figures=tuple(f for f in feature.figures if f.name not in "xyz"),
                place_mm=None,
                direction=None,
            )
            if feature.name in self.again and not feature.problem
            else feature
            for feature in inspection.features
        ]
        return replace(inspection, features=tuple(features))
