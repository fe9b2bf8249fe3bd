"""Numbers that were published before it showed that they are in doubt."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.protocol.messages import Point, QualityFlag
from traverse.protocol.messages.quality import flag_names

MOST_NAMED = 20  # points in one event


@dataclass(frozen=True, slots=True)
class PublishedNumbers:
    """Names such numbers in the event that puts them in doubt.

    Attributes:
        to_utc_ns: converts host monotonic times.
        points_since: points of the session since a time [UTC].
    """

    to_utc_ns: Callable[[int], int]
    points_since: Callable[[int], Sequence[Point]]

    def between(
        self, since_ns: int, until_ns: int, flags: QualityFlag
    ) -> tuple[str, dict[str, float | str]]:
        """Return an event's addition to its text, and its data."""
        from_ns = self.to_utc_ns(since_ns)
        data: dict[str, float | str] = {
            "from_ns": str(from_ns),
            "until_ns": str(self.to_utc_ns(until_ns)),
            "flags": " ".join(flag_names(flags.value)),
        }
        points = self.points_since(from_ns)[-MOST_NAMED:]
        if not points:
            return "", data
        data["points"] = " ".join(point.id for point in points)
        numbers = ", ".join(str(point.seq) for point in points)
        return f"; points that may rest on it already, by seq: {numbers}", data
