"""A session: the numbering that points belong to, and which of them may be undone."""

import uuid
from collections import deque

from traverse.protocol.messages import Point

MAX_UNDONE = 1000  # points that can be taken back, one after the other


class Session:
    """One list of points, numbered from 0; a new one at each start of the daemon.

    Args:
        begun_ns: when it began [UTC].
        note: what people said about it.

    Attributes:
        id: unique for ever.
        next_seq: the number of the next point or retraction.
    """

    def __init__(self, begun_ns: int, note: str = "") -> None:
        self.id = uuid.uuid4().hex
        self.begun_ns = begun_ns
        self.note = note
        self.next_seq = 0
        self._standing: deque[Point] = deque(maxlen=MAX_UNDONE)
        self._retracted: dict[str, Point] = {}

    @property
    def next_id(self) -> str:
        """What the next point or retraction is called."""
        return f"{self.id}-{self.next_seq}"

    @property
    def last(self) -> Point | None:
        """The last point that has not been taken back; None where there is none."""
        return self._standing[-1] if self._standing else None

    def add(self, point: Point) -> None:
        """A point or a retraction has been handed on under the next number."""
        self.next_seq += 1
        if point.retracts is None:
            self._standing.append(point)
        else:
            self._retracted[point.id] = self._standing.pop()

    def confirm(self, point: Point) -> None:
        """The oldest of those handed on is safe: it will never be taken out."""
        self._retracted.pop(point.id, None)

    def roll_back(self, point: Point) -> None:
        """The newest of those handed on is not to be: as if it had never been."""
        self.next_seq -= 1
        if point.retracts is None:
            self._standing.pop()
        else:
            self._standing.append(self._retracted.pop(point.id))
