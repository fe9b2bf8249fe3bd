"""What an arm has put in doubt after it was sent, as its clients know it."""

from collections.abc import Iterable
from functools import partial

from traverse.client.feeds import Feed, Feeds
from traverse.protocol.messages import Point, Scan
from traverse.protocol.messages.later_doubt import LaterDoubt, flagged_by

MAX_DOUBTS = 1000
MAX_SENT = 10_000


class KnownDoubts:
    """Marks what is handed on from now on; who has it already reads them."""

    def __init__(self) -> None:
        self._known: dict[LaterDoubt, None] = {}  # the newest last
        self.feeds = Feeds(partial(Feed[LaterDoubt], MAX_DOUBTS, keep_newest=True))

    def open(self) -> Feed[LaterDoubt]:
        """Return a feed that begins with those that are known."""
        feed = self.feeds.open()
        for doubt in self._known:
            feed.put(doubt)
        return feed

    def take(self, doubts: Iterable[LaterDoubt]) -> None:
        """Take what the arm says; it says the same again and again."""
        for doubt in doubts:
            if doubt not in self._known:
                self._known[doubt] = None
                self.feeds.put(doubt)
        while len(self._known) > MAX_DOUBTS:
            del self._known[next(iter(self._known))]

    def flagged(self, point: Point) -> Point:
        return flagged_by(self._known, point)

    def flagged_scan(self, block: Scan) -> Scan:
        for doubt in self._known:
            block = doubt.flagged_scan(block)
        return block


class SentPoints:
    """The latest points that a program has, of which more may be said later."""

    def __init__(self, at_most: int = MAX_SENT) -> None:
        self._at_most = at_most
        self.by_id: dict[str, Point] = {}  # the newest last

    def add(self, point: Point) -> Point | None:
        """Add a point; return one that is forgotten for it."""
        self.by_id[point.id] = point
        if len(self.by_id) <= self._at_most:
            return None
        return self.by_id.pop(next(iter(self.by_id)))

    def doubt(self, doubt: LaterDoubt) -> list[Point]:
        """Flag those that are meant; return them."""
        flagged = [doubt.flagged(point) for point in self.by_id.values()]
        changed = [point for point in flagged if point is not self.by_id[point.id]]
        self.by_id.update((point.id, point) for point in changed)
        return changed
