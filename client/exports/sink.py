"""Interface of all file formats."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import IO, Self

from traverse.client.exports.point_table import Coordinates, PointTable, table_of
from traverse.protocol.messages import Point


class Sink(ABC):
    """Writes points or tables of scans to a binary file, piece by piece.

    Args:
        file: open for writing, seekable.
        coordinates: which ones of points.
    """

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        self._file = file
        self._coordinates = coordinates
        self.n = 0

    def points(self, points: Sequence[Point]) -> None:
        """Write points.

        Raises:
            ValueError: they lack what the format requires.
        """
        self.table(table_of(points, self._coordinates))

    @abstractmethod
    def table(self, table: PointTable) -> None:
        """Write rows of a scan."""

    def end(self) -> None:  # noqa: B027 - most formats need no end
        """Write the trailer, or the header when the end is known."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if error is None:
            self.end()
