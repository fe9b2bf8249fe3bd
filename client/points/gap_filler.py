"""Request missing points from an arm's outbox, one request at a time."""

import asyncio
import logging
from collections.abc import Callable

from traverse.client.change_signal import ChangeSignal
from traverse.client.errors import ClientError, CommandRefused
from traverse.client.mqtt.connection import ReconnectingConnection
from traverse.client.points.doubts import KnownDoubts
from traverse.client.points.reorder_buffer import ReorderBuffer, ResendRequest
from traverse.client.requests import CommandClient
from traverse.client.results import Resent, StoredSession, doubts_of
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import ResendArgs

log = logging.getLogger(__name__)

ASK_S = 5.0
FIRST_WAIT_S = 0.2
LAST_WAIT_S = 10.0
ARRIVAL_S = 2.0
TAIL_S = 30.0
MAX_SILENCES = 2
CANNOT = ("command.not_available", "command.bad_args")


class GapFiller:
    """Requests missing points.

    Args:
        requests: sends requests to the outbox.
        doubts: takes those of what the outbox has.
        room: how many points may be requested now.
    """

    def __init__(
        self,
        order: ReorderBuffer,
        link: ReconnectingConnection,
        requests: CommandClient,
        doubts: KnownDoubts,
        *,
        room: Callable[[], int],
        arrived: ChangeSignal,
    ) -> None:
        self._order = order
        self._link = link
        self._requests = requests
        self._doubts = doubts
        self._room = room
        self._arrived = arrived
        self._questions = ChangeSignal()
        self._silences = 0

    def wake(self) -> None:
        self._questions.notify()

    async def run(self) -> None:
        wait_s = FIRST_WAIT_S
        while True:
            ask = await self._next_request()
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
                    self._arrived.notify()
                    continue
                self._order.unanswered(ask)
                log.warning("points are missing and cannot be had now: %s", error)
            except (ClientError, MessageError) as error:
                self._order.unanswered(ask)
                log.info("points may be missing: %s", error)
                self._count_unanswered(before, str(error))
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, LAST_WAIT_S)

    def _count_unanswered(self, before: tuple[int, int], reason: str) -> None:
        """Count points without answers: this client may read, not command."""
        n_taken, connections = before
        is_speaking = self._order.n_taken > n_taken
        if (
            is_speaking
            and self._link.is_connected
            and self._link.connections == connections
        ):
            self._silences += 1
        else:
            self._silences = 0
        if self._silences >= MAX_SILENCES:
            self._silences = 0
            self._order.refuse(f"the arm does not answer this client: {reason}")
            self._arrived.notify()

    async def _next_request(self) -> ResendRequest:
        """Wait until a point is missing, or none has arrived for a while."""
        while True:
            ask = self._order.next_request(self._room())
            if ask is not None:
                return ask
            before = self._order.n_taken
            if await self._questions.wait(TAIL_S) or before != self._order.n_taken:
                continue
            if self._order.can_request and self._room():
                return self._order.tail_request()

    async def _carry_out(self, ask: ResendRequest, arrival_s: float) -> None:
        if ask.session is None:
            result = await self._requests.result(ResendArgs(), ASK_S)
            self._doubts.take(doubts_of(result))
            self._order.listed(StoredSession.read_all(result))
            self._arrived.notify()
            return
        args = ResendArgs(session=ask.session, from_seq=ask.from_seq, to_seq=ask.to_seq)
        answer = Resent.read(await self._requests.result(args, ASK_S))
        last = self._order.resent(ask, answer)
        self._arrived.notify()
        if last is not None:
            await self._arrival(ask.session, last, arrival_s)

    async def _arrival(self, session: str, last: int, seconds: float) -> None:
        """Wait until points up to a number have arrived, or none arrives for a time."""
        loop = asyncio.get_running_loop()
        until_s, next_seq = loop.time() + seconds, self._order.next_seq_of(session)
        while (
            next_seq is not None
            and next_seq <= last
            and not self._order.needs_session_list
        ):
            left_s = until_s - loop.time()
            if left_s <= 0:
                return
            await self._arrived.wait(left_s)
            if next_seq != (now := self._order.next_seq_of(session)):
                until_s, next_seq = loop.time() + seconds, now
