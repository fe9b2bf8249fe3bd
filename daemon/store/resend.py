"""The command `resend`: any range of points again, a few at a time, behind new ones."""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeVar

from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.feed import Told, Work, outgoing
from traverse.daemon.store.queries import read_messages, read_sessions, stored_range
from traverse.daemon.store.records import StoredRange
from traverse.protocol.messages import ResendArgs

log = logging.getLogger("traverse.daemon.outbox")

TOGETHER = 50
MAX_RANGES = 32
MAX_SESSIONS = 1000
LAST = 2**53 - 1

T = TypeVar("T")


class RangeResender:
    """Sends ranges again, one after the other.

    Args:
        queue: of what is to be published.
        ask: has something done with the database.
        together: so many messages are read at once.
    """

    def __init__(
        self,
        queue: OutgoingQueue,
        ask: Callable[[Work, Told], None],
        together: int = TOGETHER,
    ) -> None:
        self._queue = queue
        self._ask = ask
        self._together = together
        self._ranges: deque[tuple[str, int, int]] = deque()
        self._is_reading = False

    async def carry_out(self, args: ResendArgs) -> Result:
        """Begin to send a range again; tells what there is.

        Raises:
            RequestRefusedError: too many ranges wait, or the database cannot be read.
        """
        session = args.session
        if session is None:
            found = await self.asked(
                lambda store: read_sessions(store.connection, MAX_SESSIONS)
            )
            return {
                "sessions": [
                    {
                        "session": one.session,
                        "begun_ns": str(one.begun_ns),
                        "first_seq": one.first_seq,
                        "last_seq": one.last_seq,
                    }
                    for one in found
                ]
            }
        self.check_room()
        to_seq = LAST if args.to_seq is None else args.to_seq
        extent: StoredRange = await self.asked(
            lambda store: stored_range(store.connection, session, args.from_seq, to_seq)
        )
        if extent.points and extent.last_seq is not None:
            # Not what comes later: that is sent anyway.
            self.send(session, args.from_seq, min(to_seq, extent.last_seq))
        return {
            "session": session,
            "from_seq": args.from_seq,
            "to_seq": args.to_seq,
            "points": extent.points,
            "first_seq": extent.first_seq,
            "last_seq": extent.last_seq,
        }

    def check_room(self) -> None:
        """See that another range may wait.

        Raises:
            RequestRefusedError: too many do.
        """
        if len(self._ranges) >= MAX_RANGES:
            raise RequestRefusedError(
                "resend.busy",
                f"{MAX_RANGES} ranges are being sent again already",
                "wait until they have come, then ask again as a new request",
            )

    def send(self, session: str, from_seq: int, to_seq: int) -> None:
        """Begin to send a range again."""
        self._ranges.append((session, from_seq, to_seq))
        self.refill()

    def refill(self) -> None:
        """Read on, where there is something to read and room for it."""
        if (
            not self._ranges
            or self._is_reading
            or self._queue.waiting("resend") > self._together
        ):
            return
        self._is_reading = True
        session, from_seq, to_seq = self._ranges[0]
        self._ask(
            lambda store: read_messages(
                store.connection, session, from_seq, to_seq, self._together
            ),
            self._read,
        )

    def _read(self, found: object) -> None:
        self._is_reading = False
        session, _, to_seq = self._ranges.popleft()
        if not isinstance(found, Sequence):
            log.warning("session %s is not sent again: %s", session, found)
            return  # who misses the points sees a gap, and asks again
        for message in found:
            self._queue.offer("resend", outgoing(message))
        if len(found) == self._together and found[-1].seq < to_seq:
            self._ranges.appendleft((session, found[-1].seq + 1, to_seq))
        self.refill()

    async def asked(self, work: Callable[[MessageDatabase], T]) -> T:
        """What comes of something done with the database.

        Raises:
            RequestRefusedError: it cannot be done.
        """
        waiting: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def told(outcome: object) -> None:
            if waiting.done():
                return
            if isinstance(outcome, Exception):
                waiting.set_exception(outcome)
            else:
                waiting.set_result(outcome)  # type: ignore[arg-type]  # what `work` gave

        self._ask(work, told)
        try:
            return await waiting
        except Exception as error:
            raise RequestRefusedError(
                "outbox.failed",
                f"the outbox cannot be read: {error}",
                "see `outbox` in health, and the event outbox.failed",
            ) from error
