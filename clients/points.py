"""An arm's points, followed: asks again for what is missing, holds the broker back.

At most `limit` points wait for the reader. From then on nothing is acknowledged, so
that the broker sends no more; what it then drops, and what comes nevertheless, is asked
for again when there is room. Where nobody reads, all is acknowledged and what there is
no room for is left in the arm's outbox, so that events and answers go on.
"""

import asyncio
import logging
from typing import Self

from clients.errors import ClientError, CommandRefused
from clients.following import Lost
from clients.link import Link
from clients.point_order import Ask, PointOrder
from clients.pulse import Pulse
from clients.requests import Requests
from clients.results import HeldSession, Resent
from protocol.messages import Point, ResendArgs

log = logging.getLogger(__name__)

ASK_S = 5.0
FIRST_WAIT_S = 0.2
LAST_WAIT_S = 10.0
ARRIVAL_S = 2.0
TAIL_S = 30.0
READER_S = 10.0
MAX_PLACES = 16
MAX_SILENCES = 2
CANNOT = ("command.not_available", "command.bad_args")


class PointStream:
    """Points and losses in their order; use with `async for`, one reader at a time.

    Args:
        order: puts them into order.
        link: the connection; points are acknowledged on it.
        requests: the way to the outbox.
        limit: so many may wait for the reader.

    Attributes:
        lost: points that could not be had any more, as far as they could be counted.
    """

    def __init__(
        self, order: PointOrder, link: Link, requests: Requests, limit: int
    ) -> None:
        self._order = order
        self._link = link
        self._requests = requests
        self._limit = limit
        self._unacknowledged: list[int] = []
        self._arrived = Pulse()
        self._questions = Pulse()
        self._is_read = False
        self._read_s = 0.0
        self._in_hand: Point | Lost | None = None
        self._taken: dict[str, int] = {}
        self._error: BaseException | None = None
        self._is_closed = False
        self._silences = 0
        self.lost = 0

    @property
    def room(self) -> int:
        """So many more points may wait."""
        return self._limit - len(self._order.ready)

    @property
    def waiting(self) -> int:
        """So many can be had without waiting."""
        return len(self._order.ready)

    @property
    def place(self) -> dict[str, int]:
        """Next numbers of the sessions: what the reader is done with does not count.

        A reader is done with a point when it asks for the next one.
        """
        return dict(self._taken or self._order.start)

    def take(self, point: Point, number: int) -> None:
        """A point has come, with the number that it is acknowledged by."""
        room = self.room
        self._order.take(point, room=room > 0)
        if room > 0 or not self._is_read:
            self._link.acknowledge(number)
        else:
            self._hold_back(number)
        self._tell_all()

    def notice(self, session: str) -> None:
        """The arm says that this is its session."""
        self._order.notice(session)
        self._tell_all()

    def link_came(self) -> None:
        """There is a connection: find out what was missed."""
        self._order.may_ask_again()
        self._tell_all()

    def link_lost(self) -> None:
        """Nothing of the old connection can be acknowledged any more."""
        self._unacknowledged.clear()

    def close(self, error: BaseException | None = None) -> None:
        """Nothing more will come."""
        self._is_closed, self._error = True, error
        self._unacknowledged.clear()
        self._arrived.beat()

    def put_down(self) -> None:
        """The reader is done with what it was given last."""
        item, self._in_hand = self._in_hand, None
        if item is None:
            return
        last = item.seq if isinstance(item, Point) else item.to_seq
        if last is not None:
            self._taken.pop(item.session, None)  # the newest stands last
            self._taken[item.session] = last + 1
            if len(self._taken) > MAX_PLACES:
                del self._taken[next(iter(self._taken))]

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Point | Lost:
        self.put_down()
        self._is_read = True
        while not self._order.ready:
            if self._error is not None:
                raise self._error
            if self._is_closed:
                raise StopAsyncIteration
            await self._arrived.wait()
        self._read_s = asyncio.get_running_loop().time()
        self._in_hand = item = self._order.ready.popleft()
        if self.room == self._limit // 2:
            self._let_go()
        if isinstance(item, Lost):
            self._tell(item)
        return item

    async def begun(self) -> None:
        """Wait until it is known from which point on they are followed."""
        while not self._order.has_begun:
            await self._arrived.wait()

    async def follow(self) -> None:
        """Ask for what is missing, until cancelled."""
        wait_s = FIRST_WAIT_S
        while True:
            ask = await self._next_ask()
            progress = self._order.next_seq_of(ask.session or "")
            before = (self._order.n_taken, self._link.connections)
            try:
                await self._carry_out(ask, ARRIVAL_S + wait_s)
                self._silences = 0
                if ask.session and progress == self._order.next_seq_of(ask.session):
                    wait_s = min(2 * wait_s, LAST_WAIT_S)
                else:
                    wait_s = FIRST_WAIT_S
                continue
            except CommandRefused as error:
                if error.code in CANNOT:
                    self._order.refuse(f"the arm cannot send points again: {error}")
                    self._tell_all()
                    continue
                self._order.unanswered(ask)
                log.warning("points are missing and cannot be had now: %s", error)
            except ClientError as error:
                self._order.unanswered(ask)
                log.info("points may be missing: %s", error)
                self._count_silence(before, str(error))
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, LAST_WAIT_S)

    def _count_silence(self, before: tuple[int, int], reason: str) -> None:
        """Points that come while nobody answers: this client may read, not command."""
        n_taken, connections = before
        is_speaking = self._order.n_taken > n_taken
        if is_speaking and self._link.is_up and self._link.connections == connections:
            self._silences += 1
        else:
            self._silences = 0
        if self._silences >= MAX_SILENCES:
            self._silences = 0
            self._order.refuse(f"the arm does not answer this client: {reason}")
            self._tell_all()

    async def _next_ask(self) -> Ask:
        """Wait until something is missing, or nothing has come for long."""
        while True:
            room = self.room
            ask = self._order.next_ask(room if room >= self._limit // 2 else 0)
            if ask is not None:
                return ask
            before = self._order.n_taken
            if await self._questions.wait(TAIL_S) or before != self._order.n_taken:
                continue
            if self._order.may_ask and room >= self._limit // 2:
                return self._order.tail_ask()

    async def _carry_out(self, ask: Ask, arrival_s: float) -> None:
        if ask.session is None:
            result = await self._requests.result(ResendArgs(), ASK_S)
            self._order.listed(HeldSession.read_all(result))
            self._tell_all()
            return
        args = ResendArgs(session=ask.session, from_seq=ask.from_seq, to_seq=ask.to_seq)
        answer = Resent.read(await self._requests.result(args, ASK_S))
        last = self._order.resent(ask, answer)
        self._tell_all()
        if last is not None:
            await self._arrival(ask.session, last, arrival_s)

    async def _arrival(self, session: str, last: int, seconds: float) -> None:
        """Wait until points up to a number are here, or for so long none came."""
        loop = asyncio.get_running_loop()
        until_s, next_seq = loop.time() + seconds, self._order.next_seq_of(session)
        while next_seq is not None and next_seq <= last and not self._order.must_list:
            left_s = until_s - loop.time()
            if left_s <= 0:
                return
            await self._arrived.wait(left_s)
            if next_seq != (now := self._order.next_seq_of(session)):
                until_s, next_seq = loop.time() + seconds, now

    def _tell_all(self) -> None:
        self._arrived.beat()
        if self._order.has_questions:
            self._questions.beat()

    def _hold_back(self, number: int) -> None:
        """Let the broker wait, but not for ever for a reader that has gone away."""
        if not self._unacknowledged:
            loop = asyncio.get_running_loop()
            loop.call_later(READER_S, self._look_after_reader)
        self._unacknowledged.append(number)

    def _look_after_reader(self) -> None:
        loop = asyncio.get_running_loop()
        if not self._unacknowledged:
            return
        if loop.time() - self._read_s >= READER_S:
            self._is_read = False
            self._let_go()
        else:
            loop.call_later(READER_S, self._look_after_reader)

    def _let_go(self) -> None:
        """Have the broker send on."""
        waiting, self._unacknowledged = self._unacknowledged, []
        for number in waiting:
            self._link.acknowledge(number)
        self._questions.beat()

    def _tell(self, lost: Lost) -> None:
        if lost.to_seq is not None:
            self.lost += lost.to_seq - lost.from_seq + 1
        log.error(
            "points %s to %s of session %s are lost: %s",
            *(lost.from_seq, lost.to_seq, lost.session, lost.reason),
        )
