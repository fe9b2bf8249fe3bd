"""Doubt that an event puts into numbers which were published before it."""

import json
from collections.abc import Iterable, Mapping
from functools import reduce
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field

from traverse.arrays import Booleans, Integers
from traverse.protocol.messages.fields import Name, TimeNs, Value
from traverse.protocol.messages.point import Point
from traverse.protocol.messages.quality import Quality, QualityFlag
from traverse.protocol.messages.scan import Scan

PointT = TypeVar("PointT", bound=Point)


class LaterDoubt(Value):
    """Numbers that were sent before an event put them in doubt."""

    points: Annotated[tuple[Name, ...], Field(max_length=64)]
    """Ids of points; all others of the time below are meant, too."""
    from_ns: TimeNs
    """Of the first reading concerned. [UTC]"""
    until_ns: TimeNs
    """Of the last reading concerned. [UTC]"""
    flags: tuple[Name, ...]
    """Quality flags that they should have had."""

    @classmethod
    def of(cls, data: Mapping[str, object]) -> "LaterDoubt | None":
        """Read an event's data; None if it names nothing.

        Raises:
            ValueError: its numbers are none.
        """
        flags = tuple(str(data.get("flags", "")).split())
        if not flags:
            return None
        points = tuple(str(data.get("points", "")).split())
        from_ns, until_ns = (
            int(str(data.get(f"{k}_ns", 0))) for k in ("from", "until")
        )
        return cls(points=points, from_ns=from_ns, until_ns=until_ns, flags=flags)

    @property
    def data(self) -> dict[str, str]:
        """As in an event."""
        times = {"from_ns": str(self.from_ns), "until_ns": str(self.until_ns)}
        return {
            **times,
            "flags": " ".join(self.flags),
            "points": " ".join(self.points),
        }

    @property
    def bits(self) -> int:
        """Its flags that are known here."""
        names = QualityFlag.__members__
        known = (names[flag.upper()] for flag in self.flags if flag.upper() in names)
        return int(reduce(QualityFlag.__or__, known, QualityFlag(0)))

    def concerns(self, times_ns: Integers) -> Booleans:
        """Return which samples were taken meanwhile, (n,)."""
        return np.asarray((times_ns >= self.from_ns) & (times_ns <= self.until_ns))

    def means(self, point_id: str, time_ns: int) -> bool:
        """Return whether a point is meant."""
        return point_id in self.points or self.from_ns <= time_ns <= self.until_ns

    def flagged(self, point: PointT) -> PointT:
        """Return a point with its flags, if it is meant."""
        if not self.means(point.id, point.time_ns):
            return point
        every = tuple(dict.fromkeys((*point.quality.flags, *self.flags)))
        if every == point.quality.flags:
            return point
        return point.model_copy(update={"quality": Quality(ok=False, flags=every)})

    def flagged_scan(self, scan: Scan) -> Scan:
        """Return a block with its flags, where they are meant."""
        rows = self.concerns(scan.time_ns + np.asarray(scan.dtime_ns, np.int64))
        if not rows.any():
            return scan
        quality = np.where(rows, scan.quality | self.bits, scan.quality)
        return scan.model_copy(update={"quality": quality.astype(scan.quality.dtype)})


def flagged_by(doubts: Iterable[LaterDoubt], point: PointT) -> PointT:
    """Return a point with the flags of all that mean it."""
    return reduce(lambda marked, doubt: doubt.flagged(marked), doubts, point)


def doubts_of_lines(text: str) -> list[LaterDoubt]:
    """Read events' data, one in a line.

    Raises:
        ValueError: a line is none.
    """
    tables = [json.loads(line) for line in text.splitlines() if line.strip()]
    return [doubt for data in tables if (doubt := LaterDoubt.of(dict(data)))]
