"""Stream of an arm's points: requests missing ones, and holds the broker back.

At most `limit` points wait for the reader. From then on nothing is acknowledged, so
that the broker sends no more; dropped points are requested again when there is room.
Without a reader all is acknowledged, and points without room are left in the arm's
outbox, so that events and answers continue.
"""

import asyncio
import logging
from typing import Self

from traverse.client.change_signal import ChangeSignal
from traverse.client.mqtt.connection import ReconnectingConnection
from traverse.client.points.doubts import KnownDoubts
from traverse.client.points.gap_filler import GapFiller
from traverse.client.points.reorder_buffer import ReorderBuffer
from traverse.client.points.session_order import Lost
from traverse.client.requests import CommandClient
from traverse.protocol.messages import Point

log = logging.getLogger(__name__)

READER_S = 10.0
MAX_PLACES = 16


class PointStream:
    """Points and losses in their order; use with `async for`, one reader at a time.

    Args:
        link: the connection; points are acknowledged on it.
        requests: sends requests to the outbox.
        doubts: what is in doubt since it was sent; points have its flags.
        limit: most points waiting for the reader.

    Attributes:
        follow: requests missing points, until cancelled.
        lost: unavailable points, as far as counted.
    """

    def __init__(
        self,
        order: ReorderBuffer,
        link: ReconnectingConnection,
        requests: CommandClient,
        doubts: KnownDoubts,
        limit: int,
    ) -> None:
        self._order = order
        self._doubts = doubts
        self._link = link
        self._limit = limit
        self._unacknowledged: list[int] = []
        self._arrived = ChangeSignal()
        self._gap_filler = GapFiller(
            order,
            link,
            requests,
            doubts,
            room=self._room_for_more,
            arrived=self._arrived,
        )
        self.follow = self._gap_filler.run
        self._has_reader = False
        self._read_s = 0.0
        self._current: Point | Lost | None = None
        self._next_seqs: dict[str, int] = {}
        self._error: BaseException | None = None
        self._is_closed = False
        self.lost = 0

    @property
    def room(self) -> int:
        return self._limit - len(self._order.ready)

    @property
    def waiting(self) -> int:
        return len(self._order.ready)

    @property
    def cursor(self) -> dict[str, int]:
        """Next numbers of the sessions after the reader's last point.

        A point is done when the next one is requested.
        """
        return dict(self._next_seqs or self._order.sessions.start)

    def take(self, point: Point, number: int) -> None:
        room = self.room
        self._order.take(point, room=room > 0)
        if room > 0 or not self._has_reader:
            self._link.acknowledge(number)
        else:
            self._defer_ack(number)
        self._notify_all()

    def notice(self, session: str) -> None:
        """Take the arm's present session."""
        self._order.notice(session)
        self._notify_all()

    def link_changed(self, is_connected: bool) -> None:
        if is_connected:
            self._order.connection_restored()
            self._notify_all()
        else:  # nothing of the old one can be acknowledged any more
            self._unacknowledged.clear()

    def close(self, error: BaseException | None = None) -> None:
        self._is_closed, self._error = True, error
        self._unacknowledged.clear()
        self._arrived.notify()

    def commit_current(self) -> None:
        """Mark the item returned last as processed."""
        item, self._current = self._current, None
        if item is None:
            return
        last = item.seq if isinstance(item, Point) else item.to_seq
        if last is not None:
            self._next_seqs.pop(item.session, None)  # the newest is last
            self._next_seqs[item.session] = last + 1
            if len(self._next_seqs) > MAX_PLACES:
                del self._next_seqs[next(iter(self._next_seqs))]

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Point | Lost:
        self.commit_current()
        self._has_reader = True
        while not self._order.ready:
            if self._error is not None:
                raise self._error
            if self._is_closed:
                raise StopAsyncIteration
            await self._arrived.wait()
        self._read_s = asyncio.get_running_loop().time()
        self._current = item = self._order.ready.popleft()
        if self.room == self._limit // 2:
            self._flush_acks()
        if isinstance(item, Lost):
            self._report_lost(item)
            return item
        return self._doubts.flagged(item)

    async def begun(self) -> None:
        """Wait until the first point to be followed is known."""
        while not self._order.sessions.has_begun:
            await self._arrived.wait()

    def _room_for_more(self) -> int:
        """Return how many points may be requested: none while many wait."""
        return self.room if self.room >= self._limit // 2 else 0

    def _notify_all(self) -> None:
        self._arrived.notify()
        if self._order.needs_request:
            self._gap_filler.wake()

    def _defer_ack(self, number: int) -> None:
        """Delay acknowledgements, within a limit in case the reader has left."""
        if not self._unacknowledged:
            loop = asyncio.get_running_loop()
            loop.call_later(READER_S, self._check_reader)
        self._unacknowledged.append(number)

    def _check_reader(self) -> None:
        loop = asyncio.get_running_loop()
        if not self._unacknowledged:
            return
        if loop.time() - self._read_s >= READER_S:
            self._has_reader = False
            self._flush_acks()
        else:
            loop.call_later(READER_S, self._check_reader)

    def _flush_acks(self) -> None:
        """Acknowledge all, so that the broker continues."""
        waiting, self._unacknowledged = self._unacknowledged, []
        for number in waiting:
            self._link.acknowledge(number)
        self._gap_filler.wake()

    def _report_lost(self, lost: Lost) -> None:
        if lost.to_seq is not None:
            self.lost += lost.to_seq - lost.from_seq + 1
        log.error(
            "points %s to %s of session %s are lost: %s",
            *(lost.from_seq, lost.to_seq, lost.session, lost.reason),
        )


class PointIterator:
    """The points of a stream; losses are logged and counted."""

    def __init__(self, stream: PointStream) -> None:
        self._stream = stream

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Point:
        while True:
            item = await anext(self._stream)
            if isinstance(item, Point):
                return item
