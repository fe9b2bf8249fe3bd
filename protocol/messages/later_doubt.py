"""Doubt that an event puts into numbers which were published before it."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import TypeVar

import numpy as np

from traverse.arrays import Booleans, Integers
from traverse.protocol.messages.point import Point
from traverse.protocol.messages.quality import Quality, QualityFlag
from traverse.protocol.messages.scan import Scan

PointT = TypeVar("PointT", bound=Point)


@dataclass(frozen=True, slots=True)
class LaterDoubt:
    """Numbers that an event names, and the flags that they should have had.

    Attributes:
        ids: of points.
        from_ns, until_ns: UTC of the first and last reading concerned.
        flags: names of quality flags.
    """

    ids: frozenset[str]
    from_ns: int
    until_ns: int
    flags: tuple[str, ...]

    @classmethod
    def of(cls, data: Mapping[str, object]) -> "LaterDoubt | None":
        """Read an event's data; None if it names nothing.

        Raises:
            ValueError: its numbers are none.
        """
        flags = tuple(str(data.get("flags", "")).split())
        if not flags:
            return None
        ids = frozenset(str(data.get("points", "")).split())
        from_ns, until_ns = (str(data.get(f"{k}_ns", 0)) for k in ("from", "until"))
        return cls(ids, int(from_ns), int(until_ns), flags)

    @property
    def bits(self) -> int:
        """Its flags that are known here."""
        names = QualityFlag.__members__
        known = (names[flag.upper()] for flag in self.flags if flag.upper() in names)
        return int(reduce(QualityFlag.__or__, known, QualityFlag(0)))

    def concerns(self, times_ns: Integers) -> Booleans:
        """Return which samples were taken meanwhile, (n,)."""
        return np.asarray((times_ns >= self.from_ns) & (times_ns <= self.until_ns))

    def flagged(self, point: PointT) -> PointT:
        """Return a point with its flags, if it is meant."""
        if (
            point.id not in self.ids
            and not self.from_ns <= point.time_ns <= self.until_ns
        ):
            return point
        every = tuple(dict.fromkeys((*point.quality.flags, *self.flags)))
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
