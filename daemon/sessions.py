"""A session: the numbering that points belong to, and which of them may be undone."""

import uuid
from collections import deque

from protocol.messages import Point

MAX_UNDONE = 1000  # points that can be taken back, one after the other


class Session:
    """One list of points, numbered from 0; a new one at each start of the daemon.

    Attributes:
        id: unique for ever.
        note: what people said about it.
        next_seq: the number of the next point or retraction.
    """

    def __init__(self, note: str = "") -> None:
        self.id = uuid.uuid4().hex
        self.note = note
        self.next_seq = 0
        self._standing: deque[Point] = deque(maxlen=MAX_UNDONE)

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
            self._standing.pop()
